"""Pure: recordings through the companion's eyes."""
