"""The demonstration: an operator's script, the two processes it needs, the judge of a flight."""
