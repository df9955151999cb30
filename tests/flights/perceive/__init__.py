"""Random flights by sight: nothing is told but a rough target, a lidar sees what is there.

    python -m tests.flights.perceive --seeds 1:201 --workers 2 --out DIR

Each seed is another line: one or two circuits, turned by up to 10 degrees from the perpendicular
of the plane, conductors of 15 to 40 mm, trees, and an obstacle across the straight way or none;
another wind of up to 8 m/s with gusts, noise of the position, and autopilot. The site file that the
companion has is empty. Judged by true positions: the hull, a ball of the vehicle's radius, touches
no wire, solid or tree while it is in the air. Whether the target is reached is told, with the
reason where it is not: some lines leave no way.
"""
