"""Points of a lidar or OBSTACLE_DISTANCE in; conductors, other obstacles, ground out. No I/O."""
