"""Pure: the mission's state machine, its values, and when to plan anew."""
