"""Before and after a flight, never in it.

In: recordings, sites, vehicles, plans. Out: `replay` of recordings, the paper's experiments rerun
(`evaluation`), `pictures`. Read first: `replay.player`, `evaluation.experiments`,
`pictures.plan_picture`.
"""
