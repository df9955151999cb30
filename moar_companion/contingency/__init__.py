"""Pure: exit and evacuation kept planned, and what they take of time and energy."""
