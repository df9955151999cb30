"""Pure: checks, the table of conditions, the supervisor, the setpoint gate, paths of failsafes."""
