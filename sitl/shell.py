"""The process around the fake autopilot: arguments, sockets, the clock, the truth log.

Exit status: 0 stopped by the user; 2 bad input (one line on stderr); 1 a port or file that cannot
be opened.
"""

import argparse
import asyncio
import contextlib
import math
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, NoReturn, Protocol

from sitl.autopilot import FakeAutopilot, Options, Truth
from sitl.geodesy import Geodetic
from sitl.links import LinkOptions
from sitl.manners import KINDS
from sitl.parameters import Firmware, Parameters
from sitl.ports import Port, Url, open_port
from sitl.scenario import Scenario
from sitl.signing import SignOptions
from sitl.terminal import printable
from sitl.truth_log import PERIOD_S, TruthLog
from sitl.yaml_input import BadInputError

if TYPE_CHECKING:
    from sitl.lidar_scene import PlacedScene
    from sitl.lidar_sender import LidarSender
    from sitl.payload_sender import PayloadSender
    from sitl.picture import PictureScene

_PERIOD_S: Final = 0.01
"""Period of the checks of the clock, in real time."""
_LIDAR_STEP_S: Final = 0.02
"""Longest step with a lidar, which interpolates poses between steps, or a camera."""
_MAX_LAG_S: Final = 0.5
"""A process that was stopped for longer continues from its own time."""
_DEFAULT_LINKS: Final = ("companion=udpout:127.0.0.1:14540", "gcs=udpout:127.0.0.1:14550")
_DEFAULT_HOME: Final = "47.397742,8.545594,489.4"
"""PX4's own home."""
_GROUND_STATION_NAMES: Final = ("gcs", "qgc", "operator")


class _Bad(Exception):  # noqa: N818 - it is the user's input that is bad
    """An argument that cannot be used."""


class _Parser(argparse.ArgumentParser):
    """Reports errors in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"sitl: {printable(message)}\n")


@dataclass(frozen=True, slots=True, kw_only=True)
class LidarSettings:
    """The lidar on the aircraft: its scene, and the UDP address that gets its packets."""

    scene: "PlacedScene"
    host: str
    port: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraSettings:
    """Camera and gimbal on the aircraft: their scene, the companion's address, their pictures."""

    scene: "PictureScene"
    host: str
    port: int
    folder: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Values of the arguments."""

    options: Options
    urls: dict[str, Url]
    speed: float
    truth: Path | None
    lidar: LidarSettings | None
    camera: CameraSettings | None


def read_arguments(arguments: Sequence[str] | None) -> Settings:
    """Read the command line; exits with status 2 and one line when it cannot be used."""
    parser = _Parser(
        prog="python -m sitl",
        description="A fake autopilot that talks MAVLink like a real PX4 or ArduPilot.",
    )
    parser.add_argument(
        "--autopilot",
        choices=tuple(KINDS),
        default="px4",
        help="simulated autopilot (default: px4)",
    )
    parser.add_argument(
        "--home",
        metavar="LAT,LON,ALT[,YAW]",
        help="place of the aircraft: degrees, metres above mean sea level, compass degrees",
    )
    parser.add_argument(
        "--link",
        metavar="NAME=URL",
        action="append",
        help="udpin, udpout, tcpin or tcp :HOST:PORT, repeatable; names gcs... get a ground "
        f"station's messages (default: {' and '.join(_DEFAULT_LINKS)})",
    )
    parser.add_argument("--scenario", metavar="FILE", help="timed changes of the conditions")
    parser.add_argument("--speed", type=float, default=1.0, help="simulated seconds in a real one")
    parser.add_argument("--truth", metavar="FILE.csv", help="log of the true states, at 20 Hz")
    parser.add_argument(
        "--seed", type=int, default=1, help="another flight under the same conditions (default: 1)"
    )
    parser.add_argument(
        "--firmware", metavar="VERSION", help="report this version; parameters have its names"
    )
    parser.add_argument(
        "--param",
        metavar="NAME=VALUE",
        action="append",
        help="set a parameter at start, by the firmware's name; repeatable",
    )
    parser.add_argument("--lidar", metavar="HOST:PORT", help="send a VLP-16's packets there by UDP")
    parser.add_argument("--lidar-scene", metavar="FILE", help="objects around the lidar")
    parser.add_argument(
        "--camera", metavar="HOST:PORT", help="a camera and a gimbal talk to a companion there"
    )
    parser.add_argument("--camera-scene", metavar="FILE", help="what the camera sees")
    parser.add_argument("--pictures", metavar="DIR", help="its pictures (default: pictures)")
    parser.add_argument("--sign-key", metavar="FILE", help="sign all links with the key in a file")
    args = parser.parse_args(_joined(sys.argv[1:] if arguments is None else arguments))
    try:
        urls = _links(args.link or _DEFAULT_LINKS)
        _check_speed(args.speed)
        home, yaw_deg = _home(args.home)
        signing = None if args.sign_key is None else _sign_options(Path(args.sign_key))
        lidar = _lidar(args.lidar, args.lidar_scene)
        camera = _camera(args.camera, args.camera_scene, args.pictures)
        kind = KINDS[args.autopilot]
        firmware = None if args.firmware is None else _firmware(args.firmware)
        options = Options(
            autopilot=args.autopilot,
            latitude_deg=home.latitude_deg,
            longitude_deg=home.longitude_deg,
            altitude_amsl_m=home.altitude_amsl_m,
            yaw_deg=yaw_deg,
            scenario=Scenario.load(Path(args.scenario)) if args.scenario else Scenario(),
            seed=args.seed,
            links=tuple(
                LinkOptions(
                    name=name,
                    profile="normal" if name.startswith(_GROUND_STATION_NAMES) else "onboard",
                    signing=signing,
                )
                for name in urls
            ),
            firmware=firmware,
            parameters=_parameters(
                args.param or [], kind.parameters({}, firmware or kind.firmware)
            ),
        )
    except (_Bad, BadInputError) as error:
        parser.error(str(error))
    return Settings(
        options=options,
        urls=urls,
        speed=args.speed,
        truth=Path(args.truth) if args.truth else None,
        lidar=lidar,
        camera=camera,
    )


def _joined(arguments: Sequence[str]) -> list[str]:
    """Let `--home -33.1,151.2,20` mean `--home=-33.1,...`: a minus is no option there."""
    joined: list[str] = []
    for argument in arguments:
        if joined and joined[-1] == "--home":
            joined[-1] = f"--home={argument}"
        else:
            joined.append(argument)
    return joined


def _check_speed(speed: float) -> None:
    if not (math.isfinite(speed) and speed > 0.0):
        raise _Bad(f"--speed {speed:g}: must be more than 0")


def _home(text: str | None) -> tuple[Geodetic, float]:
    """Return the place and the heading in degrees."""
    if text is None:
        text = _DEFAULT_HOME
    allowed = "must be LAT,LON,ALT or LAT,LON,ALT,YAW"
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        raise _Bad(f"--home {text!r}: {allowed}") from None
    if len(numbers) not in (3, 4) or not all(math.isfinite(number) for number in numbers):
        raise _Bad(f"--home {text!r}: {allowed}")
    if abs(numbers[0]) > 89.0 or abs(numbers[1]) > 180.0:
        raise _Bad(f"--home {text!r}: latitude within 89, longitude within 180 degrees")
    place = Geodetic(latitude_deg=numbers[0], longitude_deg=numbers[1], altitude_amsl_m=numbers[2])
    return place, numbers[3] if len(numbers) == 4 else 0.0


def _links(texts: Sequence[str]) -> dict[str, Url]:
    urls: dict[str, Url] = {}
    for text in texts:
        name, found, url = text.partition("=")
        if not found or not name:
            raise _Bad(f"--link {text!r}: must be NAME=URL")
        if name in urls:
            raise _Bad(f"--link {text!r}: there is already a link named {name}")
        try:
            urls[name] = Url.parse(url)
        except ValueError as error:
            raise _Bad(f"--link {name}: {error}") from None
    return urls


def _lidar(address: str | None, scene: str | None) -> LidarSettings | None:
    if address is None and scene is None:
        return None
    if address is None or scene is None:
        missing, given = ("--lidar", "--lidar-scene")[:: 1 if address is None else -1]
        raise _Bad(f"{missing}: is missing beside {given}")
    try:
        url = Url.parse(f"udpout:{address}")
    except ValueError:
        raise _Bad(f"--lidar {address!r}: must be HOST:PORT") from None
    from sitl.lidar_scene import PlacedScene  # noqa: PLC0415 -- it loads a compiler

    return LidarSettings(scene=PlacedScene.load(Path(scene)), host=url.host, port=url.port)


def _camera(address: str | None, scene: str | None, pictures: str | None) -> CameraSettings | None:
    if address is None and scene is None and pictures is None:
        return None
    if address is None or scene is None:
        raise _Bad("--camera and --camera-scene: both must be given")
    try:
        url = Url.parse(f"udpout:{address}")
    except ValueError:
        raise _Bad(f"--camera {address!r}: must be HOST:PORT") from None
    from sitl.picture import PictureScene  # noqa: PLC0415 -- few simulations have a camera

    return CameraSettings(
        scene=PictureScene.load(Path(scene)),
        host=url.host,
        port=url.port,
        folder=Path(pictures or "pictures"),
    )


def _sign_options(path: Path) -> SignOptions:
    try:
        return SignOptions.load(path)
    except OSError as error:
        raise _Bad(f"--sign-key {path}: {error.strerror}") from None
    except ValueError as error:
        raise _Bad(f"--sign-key {path}: {error}") from None


def _firmware(text: str) -> Firmware:
    parts = text.split(".")
    if len(parts) != 3 or not all(part.isdecimal() and int(part) < 256 for part in parts):
        raise _Bad(f"--firmware {text!r}: must be MAJOR.MINOR.PATCH, as 4.7.1")
    major, minor, patch = map(int, parts)
    return major, minor, patch


def _parameters(texts: Sequence[str], known: Parameters) -> dict[str, float]:
    return dict(_parameter(text, known) for text in texts)


def _parameter(text: str, known: Parameters) -> tuple[str, float]:
    name, _, number = text.partition("=")
    try:
        value = float(number)
    except ValueError:
        raise _Bad(f"--param {text!r}: must be NAME=NUMBER") from None
    try:
        known.set(name, value)
    except KeyError:
        raise _Bad(f"--param {text!r}: no parameter is named {name!r}") from None
    except ValueError as error:
        raise _Bad(f"--param {error}") from None
    return name, value


async def run(settings: Settings) -> int:
    """Simulate in real time, times `speed`, until stopped."""
    vehicle = FakeAutopilot(settings.options)
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    log = None
    lidar = camera = None
    ports: dict[str, Port] = {}
    try:
        if settings.truth is not None:
            log = TruthLog(settings.truth, settings.options)
        if settings.lidar is not None:
            lidar = _lidar_sender(settings.lidar, settings.options.seed)
        if settings.camera is not None:
            camera = _payload_sender(settings.camera)
        for name, url in settings.urls.items():
            ports[name] = await _open(name, url, vehicle)
        print(
            f"sitl: {KINDS[settings.options.autopilot].title} at"
            f" {settings.options.latitude_deg:.6f},{settings.options.longitude_deg:.6f},"
            f"{settings.options.altitude_amsl_m:g};",
            ", ".join(f"{name}={url}" for name, url in settings.urls.items()),
            flush=True,
        )
        carried = [each for each in (log, lidar, camera) if each is not None]
        longest_s = PERIOD_S if lidar is None and camera is None else _LIDAR_STEP_S
        await _pace(vehicle, ports, carried, longest_s, settings.speed, stop)
    except OSError as error:
        print(f"sitl: {printable(str(error))}", file=sys.stderr)
        return 1
    finally:
        for port in ports.values():
            port.close()
        if log is not None:
            log.close()
        if lidar is not None:
            lidar.close()
        if camera is not None:
            camera.close()
    return 0


def _lidar_sender(settings: LidarSettings, seed: int) -> "LidarSender":
    from sitl.lidar_sender import LidarSender  # noqa: PLC0415 -- it loads a compiler

    try:
        return LidarSender(settings.scene, settings.host, settings.port, seed=seed)
    except OSError as error:
        address = f"{settings.host}:{settings.port}"
        raise OSError(f"--lidar {address}: {error.strerror or error}") from None


def _payload_sender(settings: CameraSettings) -> "PayloadSender":
    from sitl.payload import PayloadOptions  # noqa: PLC0415 -- few simulations have a camera
    from sitl.payload_sender import PayloadSender  # noqa: PLC0415

    options = PayloadOptions(scene=settings.scene)
    try:
        return PayloadSender(options, settings.host, settings.port, settings.folder)
    except OSError as error:
        address = f"{settings.host}:{settings.port}, {settings.folder}"
        raise OSError(f"--camera {address}: {error.strerror or error}") from None


class _Carried(Protocol):
    """What follows the true states."""

    def step(self, truth: Truth) -> None:
        """Take the next true state."""


async def _open(name: str, url: Url, vehicle: FakeAutopilot) -> Port:
    try:
        return await open_port(url, partial(vehicle.receive, name))
    except OSError as error:
        raise OSError(f"{name}={url}: {error.strerror or error}") from None


async def _pace(
    vehicle: FakeAutopilot,
    ports: dict[str, Port],
    carried: Sequence[_Carried],
    longest_s: float,
    speed: float,
    stop: asyncio.Event,
) -> None:
    """Step by absolute deadlines, so that errors of sleeping do not add up.

    At a speed that is too high for the machine, the loop still reacts to a stop. longest_s: of a
    step of the true states.
    """
    start = deadline = time.monotonic()
    while not stop.is_set():
        goal_s = (deadline - start) * speed
        while vehicle.time_s + 1e-6 < goal_s and time.monotonic() < deadline + _MAX_LAG_S:
            before_s = vehicle.time_s
            vehicle.step(min(goal_s, before_s + longest_s))
            for each in carried:
                each.step(vehicle.truth)
            for name, data in vehicle.data_to_send():
                ports[name].send(data)
            if vehicle.time_s == before_s:
                break
        deadline += _PERIOD_S
        late_s = time.monotonic() - deadline
        if late_s > _MAX_LAG_S:
            start += late_s
            deadline += late_s
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(stop.wait(), max(0.0, -late_s))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the simulator; returns the exit status."""
    settings = read_arguments(arguments)
    try:
        return asyncio.run(run(settings))
    except KeyboardInterrupt:
        return 0
