"""Points to conductors and obstacles, in flight and in surveys. No I/O.

In: packets of a lidar or OBSTACLE_DISTANCE, with positions; a point cloud; a map. Out: reports of
conductors, other obstacles and the ground; a site document (`survey`). Read first:
`live_perception`, `conductors`, `survey.drawn_site`.
"""
