"""The MOAR planner: maps of a site, and the exact optimum of J on the graph of the paper. Pure.

In: `Site`, `Vehicle`; for each plan its mission, start, velocity and risks. Out: a `Plan`, with its
path, costs, and reasons. Read first: `planner`, `site`, `search`. Not used in flight: `analysis`.
"""
