"""Guidance: a plan becomes a trajectory, and the aircraft's progress along it a setpoint."""
