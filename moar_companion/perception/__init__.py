"""Points of a lidar to conductors, towers, vegetation and ground; without I/O."""
