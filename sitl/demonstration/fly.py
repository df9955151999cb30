"""Fly the demonstration: `sitl/fly`, or `python -m sitl.demonstration`.

Starts the fake autopilot (with --real one that the user has built) and the companion service as two
processes, connected only by MAVLink. Plays the operator, and judges the flight by the truth log.
Exit status 0 when the aircraft was at every target, landed at each requested landing point, touched
nothing, and left the workspace by its landing legs alone.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import webbrowser
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import yaml

from moar_companion.analysis.pictures.flight_picture import FlightStory, draw_flight
from moar_companion.analysis.pictures.perceived_picture import SeenStory, draw_perceived
from moar_companion.errors import InputError
from moar_companion.planner.maps import build_maps
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from sitl.geodesy import Geodetic
from sitl.scenario import Scenario
from sitl.terminal import printable
from sitl.yaml_input import BadInputError

from . import pictures
from .broker import BrokerError, broker_name, free_tcp_port, running_broker
from .flight_folder import gather, link_latest, make_folder
from .judge import judge, read_truth
from .manners import MANNERS
from .mqtt_reader import MqttReader
from .operator import Operator, OperatorError
from .pace import kept_speed
from .page import Page
from .perceive import ADDED, GIVEN, Perceiving, Sightings, prepare
from .pictures import Photographing
from .processes import Process, free_ports, running
from .real import Carried, RealError, RealOptions, numbers_of, running_real
from .screen import Screen, open_screen, print_text
from .script import LandingPoint, Script
from .settings import ESCAPE_COMMANDS, Settings, landing_choices, landing_points, read_settings
from .weather import Weather

_VEHICLE = "x500.yaml"
_VEHICLE_FILE = "vehicle.yaml"
"""Its name in the flight's folder."""
_ABOVE_M = 0.5
"""Least distance of the take-off's end above the least height."""
_PLANNER_READY = "planner ready"
"""In the service's log."""
_PERCEIVED = "perceived.png"
_MQTT_VEHICLE = "demonstration"


def main(arguments: list[str] | None = None) -> int:
    """Fly; returns the exit status."""
    try:
        settings = read_settings(arguments)
        site = Site.load(settings.site)
        Scenario.load(settings.scenario)
        settings.check(site)
        make_folder(settings.out)
        vehicle = _vehicle(settings, site)
        perceiving = None
        if settings.perceive:
            (port,) = free_ports(1)
            perceiving = prepare(settings.out, site, vehicle, port)
            site = perceiving.site
        photographing = None
        if settings.pictures:
            own = settings.pictures == "own"
            photographing = pictures.prepare(settings.out, settings.site, own=own)
            site = photographing.site
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
            _compile()
            problem = _fly(_paced(settings), site, perceiving, photographing)
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
    sys.stderr.write(f"sitl/fly: {printable(message)}\n")
    return status


def _height_m(site: Site) -> float:
    """The height of the take-off: of the site's start."""
    space = site.workspace
    low_m = max(space.lower_m[1], float(space.floor_m(site.start_m[0])))
    return max(site.start_m[1], low_m + _ABOVE_M)


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


def _fly(
    settings: Settings,
    site: Site,
    perceiving: Perceiving | None,
    photographing: Photographing | None,
) -> str | None:
    """Fly the whole flight; the error, or None."""
    companion_port, operator_port = free_ports(2)
    config = settings.out / "companion.yaml"
    manner = MANNERS[settings.autopilot]
    with contextlib.ExitStack() as stack:
        # A socket's path may not be long: not in the user's folder.
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        view = scratch / "view.sock"
        values = {
            "vehicle": _VEHICLE_FILE,
            "site": str(_site_file(settings, perceiving, photographing)),
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
        page = Page(scratch, opens=not settings.headless) if settings.page else None
        if page is not None:
            values["page"] = page.configuration()
            screen.print_text(f"page {page.url}")
        config.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
        log = settings.out / "companion.log"
        weather = _weather(settings, screen)
        seen = Sightings()

        def meanwhile() -> None:
            screen.refresh()
            if page is not None:
                page.open_when_served(log)
            if weather is not None:
                weather.play(operator)
            for line in seen.lines(operator.texts):
                screen.print_text(line)

        screen.print_text(f"recording to {settings.out}")
        operator = Operator(operator_port, manner, speed=settings.speed, meanwhile=meanwhile)
        stack.callback(operator.close)
        speed = str(settings.speed)
        autopilot = _autopilot(
            settings, site, perceiving, photographing, companion_port, operator_port
        )
        companion = running(
            "companion",
            log,
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
            dwells_s=tuple(target.hold_s for target in site.targets),
            landings=_landings(site, settings.landing, vehicle),
            battery_falls=_battery_falls(settings.scenario),
            planner_ready=lambda: _PLANNER_READY in log.read_text(encoding="utf-8"),
            print_text=screen.print_text,
        )
        try:
            script.fly()
        except OperatorError as error:
            fast = settings.speed > 1.0
            hint = f"; is --speed {settings.speed:g} too much for this machine?" if fast else ""
            return f"{error}{hint}"
    return None


def _site_file(
    settings: Settings, perceiving: Perceiving | None, photographing: Photographing | None
) -> Path:
    """The service's site file."""
    if perceiving is not None:
        return perceiving.given
    return settings.site if photographing is None else photographing.file


def _compile() -> None:
    """Compile the planner where it is not yet: a flight's clock does not wait for it."""
    subprocess.run([sys.executable, "-m", "moar_companion.service.compiling"], check=False)


def _paced(settings: Settings) -> Settings:
    """The settings, with a speed that this machine keeps."""
    speed = round(kept_speed(settings.speed), 1)
    if speed < settings.speed:
        print_text(f"this machine does not keep --speed {settings.speed:g} now: {speed:g}")
        return replace(settings, speed=speed)
    return settings


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
            mission=ESCAPE_COMMANDS[mission],
            index=index,
            above_m=landing_points(site, mission, index)[0][1] + above_m,
        )
        for mission, index in landing_choices(site, wanted)
    )


def _battery_falls(scenario: Path) -> bool:
    """True if the battery falls in the scenario."""
    changes = Scenario.load(scenario).changes
    return any("battery_percent" in change.targets for change in changes)


def _autopilot(
    settings: Settings,
    site: Site,
    perceiving: Perceiving | None,
    photographing: Photographing | None,
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
                parameters=numbers_of(manner.parameters) | _own_parameters(settings),
                speed=settings.speed,
                carried=_carried(perceiving, photographing, companion_port),
            )
        )
    return running(
        "autopilot",
        settings.out / "autopilot.log",
        "sitl",
        *("--autopilot", settings.autopilot),
        *("--home", _home(home, None if perceiving is None else site.frame.azimuth_deg)),
        *(() if perceiving is None else perceiving.arguments()),
        *(() if photographing is None else photographing.arguments(companion_port)),
        *("--link", f"companion=udpout:127.0.0.1:{companion_port}"),
        *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
        *(word for value in manner.parameters for word in ("--param", value)),
        *("--scenario", str(settings.scenario)),
        *("--truth", str(truth)),
        *("--speed", str(settings.speed)),
    )


def _own_parameters(settings: Settings) -> dict[str, float]:
    """Parameters of a real autopilot's own camera and gimbal, where these are flown."""
    return dict(pictures.OWN_PARAMETERS[settings.autopilot]) if settings.pictures == "own" else {}


def _carried(
    perceiving: Perceiving | None, photographing: Photographing | None, companion_port: int
) -> tuple[Callable[[], Carried], ...]:
    """What a real autopilot's aircraft carries beside its own."""
    lidar = () if perceiving is None else (perceiving.sender,)
    if photographing is None or photographing.own:
        return lidar
    return (*lidar, partial(photographing.sender, companion_port))


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
    landings = [landing_points(site, *choice) for choice in landing_choices(site, settings.landing)]
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
    if settings.pictures:
        faults += pictures.picture_faults(settings.out, site, own=settings.pictures == "own")
        print_text(f"pictures {settings.out / pictures.FOLDER}")
    print_text(
        f"least clearance {verdict.least_clearance_m:.2f} m, {len(story.plans)} paths planned"
    )
    print_text(f"picture {picture}")
    print_text(f"recording {settings.out / 'flight.tlog'}, {settings.out / 'flight.mcap'}")
    if settings.page:
        print_text(f"play it back: moar-companion page {settings.out / 'flight.mcap'}")
    for fault in faults:
        print_text(f"FAULT: {fault}")
    if not settings.headless and not faults:
        webbrowser.open(picture.as_uri())
    print_text("FAILED" if faults else "mission flown and landed")
    return 1 if faults else 0
