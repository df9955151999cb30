"""Pure: where the aircraft is, on which site, and how well that is known."""
