"""Findings of `check` on the service: its configuration, folders, broker, page and sensor."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

from ..companion.error_margin import margin_of, sight_speed_mps
from ..companion.preflight.findings import Finding, Level
from ..errors import InputError, LinkError
from ..mavlink.urls import parse_url
from ..planner.site import Site
from ..service.directories import Directory, recorder_folder, state_folder, view_socket
from ..service.page_process import listen, read_token
from ..service.perception_process import tried
from ..service.stored_parameters import StartSettings
from ..settings.config import Authority, CompanionConfig
from ..settings.link_config import KeySource, LinkRole
from ..settings.mqtt_config import Mqtt, broker_address
from ..settings.vehicle import Vehicle
from .service import INSTALLED_CONFIG

_BY_ID = Path("/dev/serial/by-id")
"""Udev's names of serial devices by maker, product and serial number."""
_NUMBERED = re.compile(r"/dev/tty(USB|ACM)\d+")
"""Names of serial devices by the order in which they were plugged in."""
_SETPOINT_BYTES, _SIGNATURE_BYTES = 65, 13
_OTHER_BYTES_PER_S = 1500.0
"""All else that the service sends: heartbeat, clock exchange, risks, texts, lists, files."""
_OWN_HOSTS = {"127.0.0.1", "::1", "localhost"}
_LONGEST_SOCKET_PATH = 107
"""Longest path in Linux's sun_path, in bytes."""


def service_findings(settings: StartSettings, site: Site | None, *, ports: bool) -> list[Finding]:
    """Returns the findings. ports: True tries the port of its sensor, too."""
    config, vehicle = settings.config, settings.vehicle
    never = config.authority is Authority.OBSERVE
    found = [
        Finding(
            level=Level.OK,
            subject="configuration",
            text=f"none, nor {INSTALLED_CONFIG}: the defaults"
            if config.file is None
            else str(config.file),
        ),
        Finding(level=Level.OK, subject="vehicle", text=f"{vehicle.name} ({config.vehicle})"),
        Finding(
            level=Level.NOTE if never else Level.OK,
            subject="authority",
            text=config.authority.value + (": nothing is ever streamed" if never else ""),
        ),
        Finding(
            level=Level.OK,
            subject="links",
            text=", ".join(
                f"{link.url} ({link.role.value}{', signed' if link.signed else ''})"
                for link in config.links
            ),
        ),
        *_serial_lines(config),
        _folder(
            "recorder",
            recorder_folder(config),
            "none: the flight is not recorded (recorder.directory)",
        ),
        _folder(
            "state",
            state_folder(config),
            "none: no state is kept after a crash (state.directory, or systemd's)",
        ),
        _view(view_socket(config)),
        _mqtt(config.mqtt),
        _page(config, ports=ports),
        _perception(config, vehicle, ports=ports),
    ]
    found += _parameters(settings)
    if config.signing != KeySource() and not any(link.signed for link in config.links):
        found.append(
            Finding(
                level=Level.WARNING,
                subject="signing",
                text="a key is named, but no link is signed",
                remedy="set signed: true on the links that are to be, or remove signing",
            )
        )
    if site is None:
        text = "none: telemetry and risk only, no mission is flown"
        found.append(Finding(level=Level.NOTE, subject="site", text=text))
    return found


def _serial_lines(config: CompanionConfig) -> Iterator[Finding]:
    """Yields warnings on serial links: a name that may change, too low a baud rate."""
    for link in config.links:
        address = parse_url(link.url)
        if address.bytes_per_s is None:
            continue
        device = Path(address.device)
        if _NUMBERED.fullmatch(address.device):
            names = [name for name in sorted(_BY_ID.glob("*")) if name.resolve() == device]
            better = f"serial:{names[0]}:{address.baud}" if names else f"a name of `ls -l {_BY_ID}`"
            yield Finding(
                level=Level.WARNING,
                subject="links",
                text=f"{device} may have another number after it is unplugged, or a restart",
                remedy=f"use {better}",
            )
        size = _SETPOINT_BYTES + (_SIGNATURE_BYTES if link.signed else 0)
        setpoints = 0.0 if link.role is LinkRole.OPERATOR else size * config.setpoint_rate_hz
        if setpoints + _OTHER_BYTES_PER_S > address.bytes_per_s:
            yield Finding(
                level=Level.WARNING,
                subject="links",
                text=f"{device} carries {address.bytes_per_s:.0f} B/s: setpoints take "
                f"{setpoints:.0f}, all else up to {_OTHER_BYTES_PER_S:.0f}",
                remedy="use a higher baud rate, on the autopilot's port, too",
            )


def _parameters(settings: StartSettings) -> list[Finding]:
    """Findings on settings that were set in flight: a line each."""
    notes = [Finding(level=Level.NOTE, subject="parameter", text=text) for text in settings.notes]
    warnings = (
        Finding(level=Level.WARNING, subject="parameter", text=text) for text in settings.problems
    )
    return [*notes, *warnings]


def _mqtt(settings: Mqtt) -> Finding:
    """Finding on the settings of the service's broker; no connection to the broker is made."""
    address = None if settings.url is None else broker_address(settings.url)
    if address is None:
        text = "none: nothing is published (mqtt.url)"
        return Finding(level=Level.NOTE, subject="mqtt", text=text)
    orders = ", takes signed orders" if settings.takes_orders else ""
    if settings.username is not None and not address.tls and address.host not in _OWN_HOSTS:
        return Finding(
            level=Level.WARNING,
            subject="mqtt",
            text=f"{address} has no TLS: the network can read the password",
            remedy="use mqtts://, or a broker on this computer that is bridged with TLS",
        )
    text = f"{address} as {settings.vehicle}{orders}"
    return Finding(level=Level.OK, subject="mqtt", text=text)


def _page(config: CompanionConfig, *, ports: bool) -> Finding:
    """Finding on the page for browsers. ports: True tries its port, too."""
    settings, subject = config.page, "page"
    if not settings.enabled:
        return Finding(level=Level.NOTE, subject=subject, text="none (page.enabled)")
    try:
        read_token(settings, str(config.file))
        if ports:
            listen(settings.host, settings.port).close()
    except (InputError, LinkError) as error:
        return Finding(level=Level.NO_GO, subject=subject, text=str(error))
    orders = ", takes orders" if settings.takes_orders else ""
    text = f"http://{settings.host}:{settings.port}{orders}"
    if orders and settings.host not in _OWN_HOSTS:
        return Finding(
            level=Level.WARNING,
            subject=subject,
            text=f"{text}: has no TLS, the network can read the token",
            remedy="use 127.0.0.1 and an SSH tunnel, or a network of your own",
        )
    return Finding(level=Level.OK, subject=subject, text=text)


def _perception(config: CompanionConfig, vehicle: Vehicle, *, ports: bool) -> Finding:
    """Finding on the sensor that measures obstacles, and on the speed that its range permits.

    ports: True tries the port of its packets, too.
    """
    settings, subject = config.perception, "perception"
    if settings.sensor is None:
        margin_m = margin_of(vehicle, config.supervision).position_m
        text = (
            "none: obstacles are those of the site file (perception.sensor); no sensor sees the "
            f"line: a position error above {margin_m:g} m that is not reported is not noticed"
        )
        return Finding(level=Level.NOTE, subject=subject, text=text)
    try:
        tried(settings, str(config.file), port=ports)
    except (InputError, LinkError) as error:
        return Finding(level=Level.NO_GO, subject=subject, text=str(error))
    most_mps, port = sight_speed_mps(vehicle, config), settings.data_port
    place = "" if port is None else f" on {settings.address}:{port}"
    text = f"{settings.sensor.value}{place}, sight {settings.sight_m:g} m"
    if most_mps < vehicle.speed.min_mps:
        return Finding(
            level=Level.NO_GO,
            subject=subject,
            text=f"{text}: at v_MIN of {vehicle.speed.min_mps:g} m/s the aircraft stops too late",
            remedy="set perception.sight_m to what the sensor sees, or reduce the margin",
        )
    return Finding(level=Level.OK, subject=subject, text=f"{text}: at most {most_mps:.1f} m/s")


def _folder(subject: str, folder: Directory | None, without: str) -> Finding:
    """Finding on write access to a folder. without: text where no folder is configured."""
    if folder is None:
        return Finding(level=Level.NOTE, subject=subject, text=without)
    problem = _folder_problem(folder.path)
    if problem is None:
        return Finding(level=Level.OK, subject=subject, text=str(folder.path))
    return Finding(
        level=Level.NO_GO,
        subject=subject,
        text=f"{folder.path} cannot be written: {problem}",
        remedy=f"correct {folder.name}, or the rights there: else the service does not start",
    )


def _folder_problem(path: Path) -> str | None:
    try:
        there = next(at for at in (path, *path.absolute().parents) if at.exists())
        if not there.is_dir():
            return f"{there} is not a directory"
    except OSError as error:
        return error.strerror or str(error)
    return None if os.access(there, os.W_OK | os.X_OK) else f"{there} belongs to another user"


def _view(place: Directory | None) -> Finding:
    """Finding on the socket of the view: the service must be able to create it."""
    if place is None:
        text = "none: no live view (view.socket, or systemd's)"
        return Finding(level=Level.NOTE, subject="view", text=text)
    problem = _socket_problem(place.path)
    if problem is None:
        return Finding(level=Level.OK, subject="view", text=str(place.path))
    return Finding(
        level=Level.NO_GO,
        subject="view",
        text=f"{place.path} cannot be made: {problem}",
        remedy=f"correct {place.name}, or the rights there: else the service does not start",
    )


def _socket_problem(path: Path) -> str | None:
    folder = path.absolute().parent
    if len(os.fsencode(path)) > _LONGEST_SOCKET_PATH:
        return f"a socket's path has no more than {_LONGEST_SOCKET_PATH} bytes"
    try:
        if path.exists() and not path.is_socket():
            return "something else is there"
        writable = folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
    except OSError as error:
        return error.strerror or str(error)
    return None if writable else f"{folder} is no folder that can be written"
