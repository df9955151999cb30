"""Fly the demonstration: `sitl/fly`, or `python -m sitl.demonstration`.

Starts the fake autopilot (with --real one that the user has built) and the companion service as two
processes, connected only by MAVLink. Plays the operator, and judges the flight by the truth log.
Exit status 0 when the aircraft was at every target, landed at each requested landing point, touched
nothing, and left the workspace by its landing legs alone.
"""

from __future__ import annotations

import contextlib
import sys
import tempfile
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import yaml

from moar_companion.config import shipped_configs
from moar_companion.errors import InputError
from moar_companion.outlets.flight_picture import FlightStory, draw_flight
from moar_companion.outlets.perceived_picture import SeenStory, draw_perceived
from moar_companion.planner.maps import build_maps
from moar_companion.site import PlanePoint, Site
from moar_companion.types import Mission
from moar_companion.vehicle import Vehicle
from sitl.geodesy import Geodetic
from sitl.scenario import Scenario
from sitl.yaml_input import BadInputError

from .broker import BrokerError, broker_name, free_tcp_port, running_broker
from .flight_folder import gather, link_latest, make_folder
from .judge import judge, read_truth
from .manners import MANNERS
from .mqtt_reader import MqttReader
from .operator import EVACUATION, EXIT, Operator, OperatorError
from .options import parser
from .perceive import ADDED, GIVEN, Perceiving, Sightings, prepare
from .processes import Process, free_ports, running
from .real import RealError, RealOptions, autopilot_at, numbers_of, running_real
from .screen import Screen, open_screen, print_text
from .script import LandingPoint, Script
from .weather import Weather

_SCENARIOS = Path(__file__).parents[1] / "scenarios"
_VEHICLE = "x500.yaml"
_VEHICLE_FILE = "vehicle.yaml"
"""Its name in the flight's folder."""
_SITE = "315kv_double_circuit.yaml"
_ESCAPE_COMMANDS = {Mission.EXIT: EXIT, Mission.EVACUATION: EVACUATION}
"""The first mission for which a site has landing points is flown, unless another is requested."""
_ALL = "all"
_TOUR = "tour.yaml"
"""The scenario of a user's own site, and of a flight with perception."""
_ABOVE_M = 0.5
"""Least distance of the take-off's end above the least height."""
_PERCEIVED = "perceived.png"
_MQTT_VEHICLE = "demonstration"


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Values of the command line."""

    headless: bool
    autopilot: str
    speed: float
    site: Path
    scenario: Path
    out: Path
    links_latest: bool
    """True for a flight in `flights/`."""
    landing: str | None
    """`exit`, `evacuation:1` (a mission, and the index of its landing point), or `all`."""
    mqtt: bool
    real: Path | None
    """PX4's build folder or ArduCopter's program; None: the fake."""
    perceive: bool
    """The service's site has rough places alone, and a lidar measures the true obstacles."""


def main(arguments: list[str] | None = None) -> int:
    """Fly; returns the exit status."""
    try:
        settings = _settings(arguments)
        site = Site.load(settings.site)
        Scenario.load(settings.scenario)
        _check(site, settings.site)
        _landing_choices(site, settings.landing)
        make_folder(settings.out)
        vehicle = _vehicle(settings, site)
        perceiving = None
        if settings.perceive:
            (port,) = free_ports(1)
            perceiving = prepare(settings.out, site, vehicle, port)
            site = perceiving.site
        if settings.mqtt:
            broker_name()
    except (InputError, BadInputError, RealError, BrokerError) as error:
        return _failed(str(error), 2)
    except OSError as error:
        return _failed(f"{settings.out}: {error.strerror}", 2)
    try:
        if settings.links_latest:
            link_latest(settings.out)
        try:
            problem = _fly(settings, site, perceiving)
        except KeyboardInterrupt:
            problem = "stopped by the user"
        return _report(settings, site, vehicle, problem)
    except BrokerError as error:
        return _failed(str(error), 1)
    except OSError as error:
        return _failed(f"{error.filename or settings.out}: {error.strerror}", 1)
    except KeyboardInterrupt:
        gather(settings.out)
        return _failed("stopped by the user, without a picture", 1)


def _failed(message: str, status: int) -> int:
    sys.stderr.write(f"sitl/fly: {message}\n")
    return status


def _check(site: Site, path: Path) -> None:
    """Check that the script can be flown on a site; InputError otherwise."""
    if not site.targets or not any(site.landing_m.values()):
        raise InputError(str(path), "", "must have targets and landing points to be flown")


def _landing_choices(site: Site, wanted: str | None) -> list[tuple[Mission, int]]:
    """The missions that end the flights and their landing points, -1 for any."""
    missions = [mission for mission in _ESCAPE_COMMANDS if site.landing_m.get(mission)]
    if wanted is None:
        return [(missions[0], -1)]
    if wanted == _ALL:
        places: dict[PlanePoint, tuple[Mission, int]] = {}
        for mission in missions:
            for index, point in enumerate(site.landing_m[mission]):
                places.setdefault(point, (mission, index))
        return list(places.values())
    name, _, number = wanted.partition(":")
    chosen = next((mission for mission in missions if mission.value == name), None)
    points = () if chosen is None else site.landing_m[chosen]
    if chosen is not None and not number:
        return [(chosen, -1)]
    if chosen is None or not (number.isascii() and number.isdigit() and int(number) < len(points)):
        allowed = [
            f"{mission.value}[:N], N < {len(site.landing_m[mission])}" for mission in missions
        ]
        raise InputError("--landing", "", f"is {wanted!r}, must be {' or '.join([*allowed, _ALL])}")
    return [(chosen, int(number))]


def _points(site: Site, mission: Mission, index: int) -> tuple[PlanePoint, ...]:
    """The landing points that an order allows."""
    points = site.landing_m[mission]
    return points if index < 0 else (points[index],)


def _height_m(site: Site) -> float:
    """The height of the take-off: of the site's start."""
    space = site.workspace
    low_m = space.lower_m[1] if space.min_altitude_m is None else space.min_altitude_m
    return max(site.start_m[1], max(low_m, space.lower_m[1]) + _ABOVE_M)


def _vehicle(settings: Settings, site: Site) -> Vehicle:
    """The X500 with the simulated autopilot and battery, as a file of the flight.

    With a lidar its nose stays in the plane: the scan plane stands across the line.
    """
    shipped = shipped_configs() / "vehicles" / _VEHICLE
    values = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    values["autopilot"] = settings.autopilot
    values["risk"]["cells"] = MANNERS[settings.autopilot].cells
    if settings.perceive:
        values["guidance"] |= {"yaw_mode": "fixed", "fixed_yaw_deg": site.frame.azimuth_deg}
    file = settings.out / _VEHICLE_FILE
    file.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return Vehicle.load(file)


def _settings(arguments: list[str] | None) -> Settings:
    read = parser().parse_args(arguments)
    real = None if read.real is None else read.real.resolve()
    autopilot = read.autopilot or "px4"
    if real is not None:
        autopilot = autopilot_at(real)
        if read.autopilot not in {None, autopilot}:
            raise RealError(f"--real {real} is {autopilot}, not --autopilot {read.autopilot}")
    calm = read.perceive or read.site is not None
    usual = _TOUR if calm else MANNERS[autopilot].scenario
    landing = read.landing or (None if read.site is None else _ALL)
    scenario = read.scenario or _SCENARIOS / usual
    started = datetime.now(tz=timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    return Settings(
        headless=read.headless,
        autopilot=autopilot,
        mqtt=read.mqtt,
        real=real,
        speed=read.speed,
        site=(read.site or shipped_configs() / "sites" / _SITE).resolve(),
        scenario=scenario.resolve(),
        out=(read.out or Path("flights") / started).resolve(),
        links_latest=read.out is None,
        landing=landing,
        perceive=read.perceive,
    )


def _fly(settings: Settings, site: Site, perceiving: Perceiving | None) -> str | None:
    """Fly the whole flight; the error, or None."""
    companion_port, operator_port = free_ports(2)
    config = settings.out / "companion.yaml"
    manner = MANNERS[settings.autopilot]
    with contextlib.ExitStack() as stack:
        # A socket's path may not be long: not in the user's folder.
        view = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "view.sock"
        values = {
            "vehicle": _VEHICLE_FILE,
            "site": str(settings.site if perceiving is None else perceiving.given),
            "links": [{"url": f"udp:127.0.0.1:{companion_port}", "role": "autopilot"}],
            "recorder": {"directory": str(settings.out)},
            "view": {"socket": str(view)},
        }
        screen = stack.enter_context(open_screen(view, live=not settings.headless))
        if perceiving is not None:
            values["perception"] = perceiving.configuration()
        if settings.mqtt:
            port = free_tcp_port()
            values["mqtt"] = {"url": f"mqtt://127.0.0.1:{port}", "vehicle": _MQTT_VEHICLE}
            stack.enter_context(_mqtt(settings, port, screen))
        config.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
        weather = _weather(settings, screen)
        seen = Sightings()

        def meanwhile() -> None:
            screen.refresh()
            if weather is not None:
                weather.play(operator)
            for line in seen.lines(operator.texts):
                screen.print_text(line)

        screen.print_text(f"recording to {settings.out}")
        operator = Operator(operator_port, manner, speed=settings.speed, meanwhile=meanwhile)
        stack.callback(operator.close)
        speed = str(settings.speed)
        autopilot = _autopilot(settings, site, perceiving, companion_port, operator_port)
        companion = running(
            "companion",
            settings.out / "companion.log",
            "sitl.demonstration.companion",
            *("--config", str(config), "--speed", speed),
        )
        vehicle = Vehicle.load(settings.out / _VEHICLE_FILE)
        script = Script(
            operator=operator,
            manner=manner,
            processes=(stack.enter_context(autopilot), stack.enter_context(companion)),
            speed=settings.speed,
            height_m=_height_m(site),
            heading_deg=site.frame.azimuth_deg if settings.real and perceiving else None,
            dwells_s=tuple(target.dwell_s for target in site.targets),
            landings=_landings(site, settings.landing, vehicle),
            battery_falls=_battery_falls(settings.scenario),
            print_text=screen.print_text,
        )
        try:
            script.fly()
        except OperatorError as error:
            fast = settings.speed > 1.0
            hint = f"; is --speed {settings.speed:g} too much for this machine?" if fast else ""
            return f"{error}{hint}"
    return None


@contextlib.contextmanager
def _mqtt(settings: Settings, port: int, screen: Screen) -> Iterator[None]:
    """A broker and a reader of all its messages, for the whole flight."""
    reader = MqttReader(settings.out / "mqtt.jsonl")
    with contextlib.closing(reader), running_broker(settings.out, port):
        reader.start(port)
        watch = f"moar-companion watch --mqtt mqtt://127.0.0.1:{port}"
        screen.print_text(f"{broker_name()} on port {port}: {watch}")
        yield
    screen.print_text(reader.summary())


def _landings(site: Site, wanted: str | None, vehicle: Vehicle) -> tuple[LandingPoint, ...]:
    """The landing points as the operator's script has them."""
    above_m = vehicle.guidance.landing_height_m
    return tuple(
        LandingPoint(
            name=mission.value,
            mission=_ESCAPE_COMMANDS[mission],
            index=index,
            above_m=_points(site, mission, index)[0][1] + above_m,
        )
        for mission, index in _landing_choices(site, wanted)
    )


def _battery_falls(scenario: Path) -> bool:
    """True if the battery falls in the scenario."""
    changes = Scenario.load(scenario).changes
    return any("battery_percent" in change.targets for change in changes)


def _autopilot(
    settings: Settings,
    site: Site,
    perceiving: Perceiving | None,
    companion_port: int,
    operator_port: int,
) -> contextlib.AbstractContextManager[Process]:
    """The process of the autopilot, fake or real."""
    point = site.frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    home = Geodetic(
        latitude_deg=point.latitude_deg,
        longitude_deg=point.longitude_deg,
        altitude_amsl_m=point.altitude_amsl_m,
    )
    manner = MANNERS[settings.autopilot]
    truth = settings.out / "truth.csv"
    if settings.real is not None:
        return running_real(
            RealOptions(
                path=settings.real,
                folder=settings.out / "autopilot",
                home=home,
                companion_port=companion_port,
                operator_port=operator_port,
                truth=truth,
                parameters=numbers_of(manner.parameters),
                speed=settings.speed,
                lidar=None if perceiving is None else perceiving.sender,
            )
        )
    return running(
        "autopilot",
        settings.out / "autopilot.log",
        "sitl",
        *("--autopilot", settings.autopilot),
        *("--home", _home(home, None if perceiving is None else site.frame.azimuth_deg)),
        *(() if perceiving is None else perceiving.arguments()),
        *("--link", f"companion=udpout:127.0.0.1:{companion_port}"),
        *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
        *(word for value in manner.parameters for word in ("--param", value)),
        *("--scenario", str(settings.scenario)),
        *("--truth", str(truth)),
        *("--speed", str(settings.speed)),
    )


def _home(place: Geodetic, yaw_deg: float | None) -> str:
    numbers = [place.latitude_deg, place.longitude_deg, place.altitude_amsl_m]
    return ",".join(repr(number) for number in [*numbers, *([] if yaw_deg is None else [yaw_deg])])


def _weather(settings: Settings, screen: Screen) -> Weather | None:
    """Scenario that the operator plays; None where the fake autopilot plays it itself."""
    if settings.real is None:
        return None
    scenario = Scenario.load(settings.scenario)
    weather = Weather(scenario=scenario, autopilot=settings.autopilot, speed=settings.speed)
    if weather.left_out:
        screen.print_text(f"the simulator cannot play {', '.join(weather.left_out)}")
    return weather


def _report(settings: Settings, site: Site, vehicle: Vehicle, problem: str | None) -> int:
    """Judge the flight, draw it, and print the result; the exit status."""
    truth = settings.out / "truth.csv"
    if not gather(settings.out) or not truth.exists():
        print_text(
            f"nothing was flown: {problem or 'no recording'}; see the logs in {settings.out}"
        )
        return 1
    story = FlightStory.read(settings.out / "decisions.jsonl")
    flight = read_truth(truth, site)
    landings = [_points(site, *choice) for choice in _landing_choices(site, settings.landing)]
    verdict = judge(flight, site, vehicle.radius_m, story.landing_legs_m, landings)
    picture = settings.out / "flight.png"
    flown = [(row.position_m[0], row.position_m[2]) for row in flight if not row.on_ground]
    draw_flight(story, flown, site, vehicle, build_maps(site, vehicle), picture)
    if settings.perceive:
        print_text(f"picture {picture}")
        seen, picture = SeenStory.read(settings.out / "decisions.jsonl"), settings.out / _PERCEIVED
        given = Site.load(settings.out / GIVEN)
        draw_perceived(seen, flown, site, given, vehicle, picture, added=ADDED)
    faults = [*([problem] if problem else []), *verdict.faults]
    print_text(
        f"least clearance {verdict.least_clearance_m:.2f} m, {len(story.plans)} paths planned"
    )
    print_text(f"picture {picture}")
    print_text(f"recording {settings.out / 'flight.tlog'}, {settings.out / 'flight.mcap'}")
    for fault in faults:
        print_text(f"FAULT: {fault}")
    if not settings.headless and not faults:
        webbrowser.open(picture.as_uri())
    print_text("FAILED" if faults else "mission flown and landed")
    return 1 if faults else 0
