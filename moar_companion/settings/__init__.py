"""Files of settings: one model for each file, its keys checked and described there."""
