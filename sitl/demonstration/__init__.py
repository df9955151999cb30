"""The demonstration: an operator's script, its two processes, the judge of a flight."""
