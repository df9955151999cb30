"""Sites, vehicles and planning problems for the tests: by hand, and at random from a seed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from moar_companion.planner.site import Conductor, Polygon, Site, Target, Workspace
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.vehicle import Guidance, SafetyShape, SpeedLimits, Vehicle
from moar_companion.types import GeodeticPoint, Mission, Weights

FRAME = SiteFrame(
    origin=GeodeticPoint(latitude_deg=45.4, longitude_deg=-71.9, altitude_amsl_m=210.0),
    azimuth_deg=90.0,
)
CORNERS = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]


def conductor(x, z, radius=0.03, *, name="conductor", keep_out=0.0):
    return Conductor(name=name, position_m=(x, z), radius_m=radius, keep_out_m=keep_out)


def polygon(*vertices, name="polygon", keep_out=0.0):
    return Polygon(name=name, vertices_m=vertices, keep_out_m=keep_out)


def make_site(
    *obstacles,
    size=(10.0, 8.0),
    lower=(0.0, 0.0),
    resolution=1.0,
    min_altitude=None,
    start=(0.5, 0.5),
    targets=None,
    exits=(),
    evacuations=(),
):
    """A site of whole cells of 1 m, empty unless obstacles are given."""
    landing = {Mission.EXIT: tuple(exits), Mission.EVACUATION: tuple(evacuations)}
    return Site(
        name="test site",
        frame=FRAME,
        workspace=Workspace(
            lower_m=lower,
            upper_m=(lower[0] + size[0], lower[1] + size[1]),
            resolution_m=resolution,
            min_altitude_m=min_altitude,
        ),
        obstacles=obstacles,
        start_m=start,
        targets=tuple(
            Target(name=name, position_m=position, dwell_s=0.0)
            for name, position in (targets or {"target": (8.5, 6.5)}).items()
        ),
        landing_m={mission: points for mission, points in landing.items() if points},
    )


def make_vehicle(
    *,
    radius=0.6,
    d_min=1.2,
    d_max=3.0,
    shares=(0.3, 0.2, 0.5),
    speeds=(10.0, 1.5, 1.5, 2.5, 2.5),
    min_speed=0.5,
    max_speed=None,
    landing_height=2.0,
):
    """The paper's LineDrone; speeds are horizontal, up, down, diagonal up, diagonal down."""
    horizontal, up, down, diagonal_up, diagonal_down = speeds
    collision, insertion, damage = (share / sum(shares) for share in shares)
    return Vehicle(
        name="test vehicle",
        autopilot=None,
        radius_m=radius,
        safety=SafetyShape(
            d_min_m=d_min, d_max_m=d_max, collision=collision, insertion=insertion, damage=damage
        ),
        speed=SpeedLimits(
            min_mps=min_speed,
            horizontal_mps=horizontal,
            up_mps=up,
            down_mps=down,
            diagonal_up_mps=diagonal_up,
            diagonal_down_mps=diagonal_down,
            max_mps=max(speeds) if max_speed is None else max_speed,
        ),
        weights=dict.fromkeys(Mission, Weights.normalised(1.0, 1.0, 1.0)),
        guidance=Guidance(landing_height_m=landing_height),
    )


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One planning problem, as the planner and the oracle are asked it."""

    site: Site
    vehicle: Vehicle
    mission: Mission
    target: str | int | None
    start_m: tuple[float, float]
    velocity_mps: tuple[float, float]
    weights: Weights

    def ask(self, planner):
        return planner.plan(
            mission=self.mission,
            target=self.target,
            start=self.start_m,
            velocity=self.velocity_mps,
            weights=self.weights,
        )


def random_vehicle(rng):
    speeds = tuple(rng.uniform(0.5, 10.0) for _ in range(5))
    if rng.random() < 0.2:
        speeds = (speeds[0],) * 5
    d_min = rng.uniform(0.2, 1.5)
    shares = rng.choice([(0.3, 0.2, 0.5), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])
    return make_vehicle(
        radius=rng.choice([0.0, rng.uniform(0.0, 0.8)]),
        d_min=d_min,
        d_max=d_min + rng.uniform(0.1, 3.0),
        shares=shares,
        speeds=speeds,
        min_speed=min(speeds) * rng.uniform(0.05, 1.0),
        max_speed=max(speeds) * rng.uniform(1.0, 1.5) if rng.random() < 0.2 else None,
        landing_height=rng.choice([0.0, 0.5, 2.0]),
    )


def random_polygon(rng, centre, size, **details):
    """A star-shaped outline about a centre: convex or not."""
    count = rng.randint(3, 7)
    turns = sorted(rng.uniform(0.0, math.tau) for _ in range(count))
    if max(b - a for a, b in zip(turns, [*turns[1:], turns[0] + math.tau], strict=True)) > 3.0:
        turns = [math.tau * index / count for index in range(count)]
    vertices = []
    for turn in turns:
        reach = size * rng.uniform(0.2, 1.0)
        vertices.append((centre[0] + reach * math.cos(turn), centre[1] + reach * math.sin(turn)))
    return polygon(*vertices, **details)


def random_obstacles(rng, lower, upper):
    """None, one, a flat circuit, walls, or a mixture of conductors and polygons, some outside."""

    def place():
        return tuple(
            rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low))
            for low, high in zip(lower, upper, strict=True)
        )

    extent = min(high - low for low, high in zip(lower, upper, strict=True))
    kind = rng.choice(["none", "one", "flat", "walls", "mixed", "mixed", "mixed"])
    if kind == "none":
        return ()
    if kind == "walls":
        walls = []
        for index in range(rng.randint(1, 3)):
            x, width = rng.uniform(lower[0], upper[0]), rng.uniform(0.05, 0.1) * extent
            gap = rng.choice([-0.1, 0.1, 0.3]) * (upper[1] - lower[1])
            low, high = lower[1] - 1.0, upper[1] - gap
            if rng.random() < 0.5:
                low, high = lower[1] + gap, upper[1] + 1.0
            corners = [(x, low), (x + width, low), (x + width, high), (x, high)]
            walls.append(polygon(*corners, name=f"wall {index}"))
        return tuple(walls)
    if kind == "flat":
        z = place()[1]
        return tuple(
            conductor(place()[0], z, name=f"flat {index}") for index in range(rng.randint(2, 4))
        )
    obstacles = []
    for index in range(1 if kind == "one" else rng.randint(2, 6)):
        details = {
            "name": f"obstacle {index}",
            "keep_out": rng.choice([0.0, 0.0, rng.uniform(0.0, 0.1 * extent)]),
        }
        if rng.random() < 0.6:
            obstacles.append(conductor(*place(), rng.uniform(0.01, 0.1 * extent), **details))
        else:
            obstacles.append(random_polygon(rng, place(), 0.2 * extent, **details))
    return tuple(obstacles)


def random_weights(rng):
    if rng.random() < 0.3:
        return Weights(*rng.choice(CORNERS))
    values = [rng.choice([0.0, rng.random(), rng.random()]) for _ in range(3)]
    return Weights.normalised(*values) if sum(values) > 0.0 else Weights(0.5, 0.25, 0.25)


def random_velocity(rng, vehicle):
    kind = rng.choice(["rest", "rest", "slow", "fast"])
    if kind == "rest":
        return (0.0, 0.0)
    speed = vehicle.speed.max_mps * (rng.uniform(0.0, 1.0) if kind == "slow" else 2.5)
    turn = rng.choice([rng.uniform(0.0, math.tau), 0.25 * math.pi * rng.randint(0, 7)])
    return (speed * math.cos(turn), speed * math.sin(turn))


def random_landing(rng, lower, upper):
    """Mostly beside or below the workspace, now and then inside it."""
    points = []
    for _ in range(rng.randint(1, 3)):
        width, height = upper[0] - lower[0], upper[1] - lower[1]
        x = rng.uniform(lower[0] - width, upper[0] + width)
        z = rng.choice([lower[1], lower[1] - 1.0, rng.uniform(lower[1], lower[1] + height)])
        points.append((x, z))
    return tuple(points)


def random_problem(rng, columns=(6, 15), rows=(5, 11)):
    resolution = rng.choice([0.3, 0.5, 1.0, rng.uniform(0.2, 1.2)])
    lower = (rng.choice([0.0, rng.uniform(-20.0, 20.0)]), rng.choice([0.0, rng.uniform(-3.0, 9.0)]))
    size = tuple(
        resolution * (rng.randint(*count) + rng.choice([0.0, 0.0, rng.uniform(0.05, 0.95)]))
        for count in (columns, rows)
    )
    upper = (lower[0] + size[0], lower[1] + size[1])
    min_altitude = rng.choice([None, lower[1] + rng.randint(0, 2) * 0.5 * resolution])
    vehicle = random_vehicle(rng)

    def place():
        return tuple(rng.uniform(low, high) for low, high in zip(lower, upper, strict=True))

    mission = rng.choice(list(Mission))
    site = make_site(
        *random_obstacles(rng, lower, upper),
        size=size,
        lower=lower,
        resolution=resolution,
        min_altitude=min_altitude,
        start=place(),
        targets={"near": place(), "far": place()},
        exits=random_landing(rng, lower, upper),
        evacuations=random_landing(rng, lower, upper),
    )
    target = None
    if mission is Mission.INSPECTION:
        target = rng.choice(["near", "far"])
    elif rng.random() < 0.3:
        target = rng.randrange(len(site.landing_m[mission]))
    return Problem(
        site=site,
        vehicle=vehicle,
        mission=mission,
        target=target,
        start_m=rng.choice([site.start_m, place(), site.targets[0].position_m]),
        velocity_mps=random_velocity(rng, vehicle),
        weights=random_weights(rng),
    )
