"""Random flights that capture views, with wind and faults of camera, gimbal, link and pilot.

    python -m tests.flights.views --seeds 1:201 --workers 2 --out DIR

The shipped site of 315 kV, with three aims from the place of one splice (level, up, down) and one
of the other. Judged by the pictures as they truly are: each that the record counts has its aim in
its middle fifth and is sharp, or is marked; none is taken twice without need; the gimbal is taken
from nobody, and given back.
"""
