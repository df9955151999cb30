"""Pure: the mission's state machine, its values, and the reasons to replan."""
