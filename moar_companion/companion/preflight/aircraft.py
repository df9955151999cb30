"""Check of the aircraft before the flight: received data in, findings out. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from ...mavlink.autopilots import PROFILES, profile
from ...mavlink.dialect import id_of
from ...mavlink.identity import Autopilot
from ...mavlink.message_rates import wanted_rates_hz
from ...mavlink.telemetry import AutopilotStatus, LandedState, Telemetry
from ...planner.site import Site
from ...risk import RiskEstimate
from ...settings.config import Supervision
from ...settings.risk_model import RiskModel
from ...settings.vehicle import Vehicle
from ...texts.text_format import compass
from ..estimation.landed_state import grounded
from ..estimation.pose import Pose
from ..safety.position_checks import ATTITUDE_TIMEOUT_S
from .battery_check import battery_findings
from .findings import Finding, Level
from .risks import risk_findings

_FAR_M = 500.0
"""Distance from the structure beyond which no take-off is plausible."""
_HEIGHT_ERROR_M = 1.0
"""Error of an altitude reported as good: PX4's estimate was off by up to 0.83 m, once by 1.4 m."""
_NO_KEEP_OUT_M = 3.0
"""Usual error of a receiver's altitude, on a site without obstacles."""
_ENOUGH = 0.5
"""Fraction of the wanted rate."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrivals:
    """Arrivals of a message: their number, first and last time, and the longest pause.

    Messages in one piece of data count once.
    """

    count: int = 0
    first_s: float = 0.0
    last_s: float = 0.0
    longest_gap_s: float = 0.0

    def another(self, now_s: float) -> Arrivals:
        """Returns the arrivals with one more now."""
        if self.count == 0:
            return Arrivals(count=1, first_s=now_s, last_s=now_s)
        return replace(self.until(now_s), count=self.count + 1, last_s=now_s)

    def until(self, now_s: float) -> Arrivals:
        """Returns the arrivals with the pause that lasts until now."""
        if self.count == 0:
            return self
        return replace(self, longest_gap_s=max(self.longest_gap_s, now_s - self.last_s))

    @property
    def rate_hz(self) -> float | None:
        """Mean rate; None before two arrivals."""
        elapsed_s = self.last_s - self.first_s
        return (self.count - 1) / elapsed_s if elapsed_s > 0.0 else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceivedData:
    """Data received of an aircraft during the check.

    pose: in the frame of the site; None without one. causes: the service's reasons against a
    flight. positions, attitudes: arrivals of LOCAL_POSITION_NED and ATTITUDE.
    """

    autopilot: Autopilot
    status: AutopilotStatus
    others: tuple[Autopilot, ...]
    telemetry: Telemetry
    risk: RiskEstimate
    positions: Arrivals
    attitudes: Arrivals
    pose: Pose | None
    causes: Mapping[str, str]


def aircraft_findings(
    received: ReceivedData, vehicle: Vehicle, site: Site | None, limits: Supervision
) -> list[Finding]:
    """Returns all findings on the aircraft except those on its parameters."""
    batteries = battery_findings(received.telemetry, vehicle.risk)
    return [
        *_identity(received, vehicle),
        _firmware(received),
        *_state(received),
        *_rates(received, limits),
        *(() if site is None else _place(received, site, vehicle)),
        *batteries,
        *risk_findings(received.risk, received.causes, batteries),
        _drag(vehicle.risk),
        *_people(received),
    ]


def _identity(received: ReceivedData, vehicle: Vehicle) -> Iterator[Finding]:
    autopilot = received.autopilot
    if autopilot.kind not in PROFILES:
        known = " nor ".join(row.name for row in PROFILES.values())
        yield Finding(
            level=Level.NO_GO,
            subject="autopilot",
            text=f"{autopilot} is neither {known}",
            remedy="fly with one of these: no other is supported",
        )
    elif vehicle.autopilot not in (None, autopilot.kind):
        yield Finding(
            level=Level.NO_GO,
            subject="autopilot",
            text=f"{autopilot}, and the vehicle file names {vehicle.autopilot}",
            remedy="correct `autopilot` in the vehicle file: each has its own map projection",
        )
    elif "autopilot_identity" in received.causes:
        yield Finding(
            level=Level.NO_GO,
            subject="autopilot",
            text=f"{autopilot}: {received.causes['autopilot_identity']}",
            remedy="only multirotors are flown",
        )
    else:
        yield Finding(level=Level.OK, subject="autopilot", text=str(autopilot))
    for other in received.others:
        yield Finding(
            level=Level.NO_GO,
            subject="autopilot",
            text=f"a second one is received, {other}",
            remedy="no control with two autopilots: switch one off, or separate the links",
        )


def _firmware(received: ReceivedData) -> Finding:
    firmware, known = received.telemetry.firmware, profile(received.autopilot.kind)
    if firmware is None:
        return Finding(
            level=Level.WARNING,
            subject="firmware",
            text="unknown, the autopilot does not report its version",
            remedy="look it up in the ground station",
        )
    release = firmware.version[:2]
    measured = " and ".join(f"{major}.{minor}" for major, minor in known.measured_releases)
    shown = f"{known.name} {firmware}"
    if release in known.measured_releases:
        return Finding(level=Level.OK, subject="firmware", text=shown)
    text = f"{shown}; this program was tested with {measured or 'none of this kind'}"
    if release < known.oldest_release:
        return Finding(
            level=Level.WARNING,
            subject="firmware",
            text=text,
            remedy="its failsafes may differ: update it",
        )
    if known.is_newer(firmware):
        newest = ".".join(map(str, known.newest_release))
        return Finding(
            level=Level.WARNING,
            subject="firmware",
            text=f"{text}, and knows the parameters up to {newest}",
            remedy="its failsafes and parameters may differ: update this program",
        )
    return Finding(level=Level.NOTE, subject="firmware", text=text)


def _state(received: ReceivedData) -> Iterator[Finding]:
    status, readiness = received.status, received.telemetry.readiness
    landed = received.telemetry.landed
    words = ", ".join(
        (
            status.mode,
            "armed" if status.armed else "disarmed",
            "landed state unknown" if landed is None else _LANDED_WORDS[landed.state],
        )
    )
    if status.failsafe:
        yield Finding(
            level=Level.NO_GO,
            subject="state",
            text=f"{words}, in failsafe",
            remedy="the ground station shows the cause: correct it first",
        )
    else:
        yield Finding(level=Level.NOTE, subject="state", text=words)
    if readiness is None:
        yield Finding(
            level=Level.NO_GO,
            subject="ready to arm",
            text="unknown, there is no SYS_STATUS",
            remedy="check the link's message rates",
        )
        return
    unhealthy = f", unhealthy: {', '.join(readiness.unhealthy)}" if readiness.unhealthy else ""
    if status.armed:
        yield Finding(
            level=Level.WARNING if not readiness.ready else Level.NOTE if unhealthy else Level.OK,
            subject="ready to arm",
            text="armed" + ("" if readiness.ready else ", would not arm now") + unhealthy,
            remedy="" if readiness.ready else "the ground station shows the reason",
        )
    elif readiness.ready:
        yield Finding(level=Level.OK, subject="ready to arm", text="yes")
    else:
        yield Finding(
            level=Level.NO_GO,
            subject="ready to arm",
            text="no" + unhealthy,
            remedy="the ground station shows the reason; after a start it takes a minute",
        )


_LANDED_WORDS = {
    LandedState.ON_GROUND: "on the ground",
    LandedState.IN_AIR: "in the air",
    LandedState.TAKEOFF: "taking off",
    LandedState.LANDING: "landing",
}


def _rates(received: ReceivedData, limits: Supervision) -> Iterator[Finding]:
    wanted_rates = wanted_rates_hz(received.autopilot.kind)
    for name, arrivals, longest_s in (
        ("LOCAL_POSITION_NED", received.positions, limits.position_timeout_s),
        ("ATTITUDE", received.attitudes, ATTITUDE_TIMEOUT_S),
    ):
        rate_hz, wanted_hz = arrivals.rate_hz, wanted_rates[id_of(name)]
        if rate_hz is None:
            yield Finding(
                level=Level.NO_GO,
                subject=name,
                text="not received",
                remedy="check the link's message rates; a position needs a GPS fix first",
            )
            continue
        text = f"{rate_hz:.0f} Hz, longest pause {arrivals.longest_gap_s:.2f} s"
        if arrivals.longest_gap_s > longest_s:
            level, remedy = Level.NO_GO, f"a pause of {longest_s:g} s ends the flight"
        elif rate_hz < _ENOUGH * wanted_hz:
            level, remedy = Level.WARNING, f"{wanted_hz:g} Hz are wanted"
        else:
            level, remedy = Level.OK, ""
        if remedy:
            remedy += ": give the companion a faster link, or fewer messages"
        yield Finding(level=level, subject=name, text=text, remedy=remedy)


def _place(received: ReceivedData, site: Site, vehicle: Vehicle) -> Iterator[Finding]:
    pose, causes = received.pose, received.causes
    before = ("autopilot_link_lost", "position", "attitude", "origin")
    obstruction = next((causes[name] for name in before if name in causes), None)
    if obstruction is not None or pose is None:
        yield Finding(
            level=Level.NO_GO,
            subject="position",
            text=obstruction or "unknown",
            remedy="wait until it is known: no flight starts before",
        )
    if pose is None:
        return
    x_m, y_m, z_m = pose.position_m
    along_m = x_m - min(max(x_m, site.workspace.lower_m[0]), site.workspace.upper_m[0])
    far_m = math.hypot(along_m, y_m)
    side = compass(site.frame.bearing_rad(along_m, y_m))
    not_ready_reason = causes.get("off_plane") or causes.get("not_hovering")
    if far_m > _FAR_M:
        yield Finding(
            level=Level.NO_GO,
            subject="position",
            text=f"{_distance(far_m)} {side} of the site {site.name}",
            remedy="load the right site file, or correct frame.origin",
        )
        return
    if far_m > vehicle.guidance.recovery_m:
        yield Finding(
            level=Level.WARNING,
            subject="position",
            text=f"{_distance(far_m)} {side} of the workspace",
            remedy=f"beyond {vehicle.guidance.recovery_m:g} m (guidance.recovery_m) an order is "
            "refused: fly nearer, or correct frame.origin",
        )
    elif not_ready_reason is not None:
        yield Finding(
            level=Level.WARNING,
            subject="position",
            text=not_ready_reason,
            remedy="hover in the plane before a mission is ordered; or correct the site's frame",
        )
    else:
        beside = compass(site.frame.bearing_rad(0.0, y_m))
        text = f"x {x_m:.1f}, z {z_m:.1f}, {abs(y_m):.1f} m {beside} of the plane"
        yield Finding(level=Level.OK, subject="position", text=text)
    if grounded(received.telemetry):
        yield _height(x_m, z_m, site)


def _height(x_m: float, z_m: float, site: Site) -> Finding:
    """Checks z of an aircraft on the ground, which should be that of the site's ground at its x.

    An error shifts the whole flight up or down, in addition to what the margin allows for.
    """
    altitude_m, ground_m = site.frame.origin.altitude_amsl_m, site.workspace.ground_at_m(x_m)
    text = f"z = {z_m:+.1f} m on the ground, by its altitude and the site's ({altitude_m:g} m)"
    if site.workspace.ground_m:
        text += f"; by the profile {ground_m:+.1f} m"
    slack_m, off_m = _HEIGHT_ERROR_M if site.obstacles else _NO_KEEP_OUT_M, z_m - ground_m
    if abs(off_m) <= slack_m:
        return Finding(level=Level.OK, subject="height", text=text)
    lowest_m, highest_m = _ground_m(site, slack_m)
    remedy = (
        f"the whole flight would be {abs(off_m):.1f} m too {'low' if off_m > 0.0 else 'high'}: "
        "correct frame.origin.altitude_amsl_m, or wait for a better fix and restart the autopilot"
    )
    if lowest_m <= z_m <= highest_m:
        return Finding(
            level=Level.WARNING,
            subject="height",
            text=text,
            remedy=f"unless the ground is at this height, {remedy}",
        )
    return Finding(
        level=Level.NO_GO,
        subject="height",
        text=f"{text}; the site's ground is within {lowest_m:+.1f} to {highest_m:+.1f} m",
        remedy=remedy,
    )


def _ground_m(site: Site, slack_m: float) -> tuple[float, float]:
    """Lowest and highest z at which an aircraft may stand on a site's ground.

    The ground is at z = 0 or on its profile, and at the landing points.
    """
    profile_m = [z_m for _, z_m in site.workspace.ground_m] or [0.0]
    grounds_m = [*profile_m, *(z_m for points in site.landing_m.values() for _, z_m in points)]
    return min(grounds_m) - slack_m, max(grounds_m) + slack_m


def _distance(distance_m: float) -> str:
    return f"{distance_m * 1e-3:,.0f} km" if distance_m >= 10_000.0 else f"{distance_m:,.0f} m"


def _drag(risk: RiskModel) -> Finding:
    """Checks the drag, from which the wind is computed by the lean."""
    text = f"{risk.drag_per_s:g} /s and {risk.drag_per_m:g} /m"
    if not risk.drag_is_usual:
        return Finding(level=Level.OK, subject="drag", text=text)
    return Finding(
        level=Level.WARNING,
        subject="drag",
        text=f"{text}, the default, not measured: the wind computed from the lean may be "
        "0.9 to 2 times the true one",
        remedy="fly straight legs in calm air, recording; `moar-companion replay FLIGHT.tlog "
        "--fit-drag` has the two lines for the vehicle file",
    )


def _people(received: ReceivedData) -> Iterator[Finding]:
    """Checks the links by which a pilot or operator can take over."""
    ground, remote = received.telemetry.ground_station, received.telemetry.remote_control
    readiness = received.telemetry.readiness
    if readiness is not None and readiness.remote_control_ok is None:
        remote = None  # channels may come without a receiver, or from one that is not used
    rssi = None if remote is None else remote.rssi
    signal = "unknown signal" if rssi is None else f"signal {rssi:.0%}"
    people = (
        _person(
            received.risk,
            "ground station",
            None if ground is None else f"received, system {ground.system_id}",
            "connect it, and let the autopilot forward its messages to this link: it carries "
            "the orders",
        ),
        _person(
            received.risk,
            "remote control",
            None if remote is None else f"received, {signal}",
            "switch it on: without it only the ground station can take over",
        ),
    )
    yield from people
    if all(item.level >= Level.WARNING for item in people):
        yield Finding(
            level=Level.NO_GO,
            subject="take over",
            text="no take-over: neither a remote control nor a ground station reaches the aircraft",
            remedy="switch one on",
        )


def _person(risk: RiskEstimate, subject: str, text: str | None, remedy: str) -> Finding:
    """Checks a link for take-over by its inputs of the communication risk.

    text: of the link; None if it was not received.
    """
    if text is None:
        return Finding(level=Level.WARNING, subject=subject, text="not received", remedy=remedy)
    bad = [
        item.phrase
        for name, item in risk.last_known.get("communication", {}).items()
        if name.startswith(subject) and Level.of_risk(item.risk or 0.0) >= Level.WARNING
    ]
    if bad:
        return Finding(level=Level.WARNING, subject=subject, text=", ".join(bad), remedy=remedy)
    return Finding(level=Level.OK, subject=subject, text=text)
