"""Random flights by sight: the site has only a rough target; a lidar sees the obstacles.

    python -m tests.flights.perceive --seeds 1:201 --workers 2 --out DIR

Each seed is another line: one or two circuits, turned by up to 10 degrees from the perpendicular
of the plane, conductors of 15 to 40 mm, and trees. Some lines have an obstacle across the straight
path. The wind of up to 8 m/s with gusts, the noise of the position and the autopilot differ, too.
The companion's site file is empty. Judged by true positions: the hull, a ball of the vehicle's
radius, touches no wire, solid or tree while it is in the air. The row has the reason if the target
was not reached: some lines leave no path.
"""
