"""Not used in flight: trade-offs, alternatives, and the paper's baselines."""
