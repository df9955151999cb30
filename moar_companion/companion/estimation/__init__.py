"""Pure: position of the aircraft on its site, and the uncertainty of it."""
