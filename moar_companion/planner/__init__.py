"""The MOAR planner: maps of a site, and the exact optimum of J on the graph of the paper."""
