"""Pure: checks, the table of conditions, the supervisor, the setpoint gate, offboard loss."""
