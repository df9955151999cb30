"""The demonstration: an operator's script, the two processes it needs, and the judge of a flight."""
