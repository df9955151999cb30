"""Points of a lidar in; conductors, towers, vegetation and ground out. Without I/O."""
