"""Before and after a flight, never in it: replay, the paper's experiments, pictures."""
