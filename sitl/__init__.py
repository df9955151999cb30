"""A fake autopilot: a MAVLink vehicle that a stranger takes for a real one.

It speaks raw pymavlink and shares no code with the companion, so that one bug cannot cancel
itself at both ends. `sitl.autopilot.FakeAutopilot` is the machine, `python -m sitl` its shell.
"""
