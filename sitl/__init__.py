"""A fake autopilot: a MAVLink vehicle with the behaviour of a real one towards other programs.

It uses raw pymavlink and shares no code with the companion, so that one bug cannot cancel itself at
both ends. `sitl.autopilot.FakeAutopilot` is the machine, `python -m sitl` its shell.
"""
