"""Before the flight: what the files and the aircraft say, and how to mend it."""
