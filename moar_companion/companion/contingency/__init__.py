"""Pure: exit and evacuation kept planned, and their time and energy."""
