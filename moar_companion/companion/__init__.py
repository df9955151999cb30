"""The companion: one machine without I/O.

In: bytes with their arrival times, answers of the planner, figures of the computer, and the time.
Out: bytes to send, plan jobs, decisions to record. Read first: `companion` (inputs and outputs),
`cycle_stages` (a cycle, stage by stage), `safety.conditions` (all reasons to act against a flight).

Parts: `mission` (the state machine), `safety` (checks, conditions, the setpoint gate), `guidance`
(a plan to setpoints), `planning` (jobs and answers), `contingency` (escape routes), `estimation`
(the aircraft's place on its site), `preflight` (findings of `check`).
"""
