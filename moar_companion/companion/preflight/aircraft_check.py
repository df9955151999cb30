"""Check of the aircraft before the flight: one machine without I/O. Bytes and time in, bytes out.

It receives as the service does, with the same ids and a heartbeat, and requests streams,
parameters and the version. It never sends a setpoint, a mode or a parameter.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from ...mavlink.autopilots import profile
from ...mavlink.autopilots.offboard_loss import OffboardLoss
from ...mavlink.autopilots.parameter_names import Parameters
from ...mavlink.autopilots.parameter_rules import Case, Rule
from ...mavlink.autopilots.profile import Profile
from ...mavlink.identity import Autopilot, AutopilotConflict
from ...mavlink.own_ids import ComponentConflict
from ...mavlink.peers import Address
from ...mavlink.session import Session, SystemStatus
from ...mavlink.signing import Signing, SigningRefusal, link_signings
from ...mavlink.telemetry import Firmware
from ...planner.planner import Planner
from ...risk import RiskEstimate, update
from ...risk.power import PowerModel
from ...settings.config import CompanionConfig, LossCheck
from ...settings.link_config import LinkRole
from ...settings.vehicle import Vehicle
from ..estimation.pose_tracker import PoseTracker
from ..safety.check_inputs import CheckInputs
from ..safety.condition_types import Look
from ..safety.conditions import causes
from .aircraft import Arrivals, ReceivedData, aircraft_findings
from .failsafes import failsafe_findings, loss_findings, objection_level
from .fence_check import fence_findings
from .findings import Finding, Level
from .risks import held_wind_finding

WAIT_S = 10.0
"""Ten heartbeats: an autopilot that sends none in this time is absent."""
_COLLECTION_S = 6.0
"""Six heartbeats, three battery messages, enough packets for a loss of some percent."""
_MAX_COLLECTION_S = 20.0
"""Time after which data that has not arrived counts as unknown."""
_RISK_PERIOD_S = 0.1

_REFUSAL_REMEDIES = {
    SigningRefusal.UNSIGNED: "give the sender the key (configs/guides/commanding.md), "
    "or find the sender",
    SigningRefusal.WRONG: "give the sender the key of `signing`, or find the sender",
    SigningRefusal.OLD: "compare the sender's clock with this computer's; "
    "if both are right, the packets are a replay",
}

_NOT_REPORTED = "look it up in the ground station; if it is there, check again over a better link"


def parameter_findings(
    autopilot: Profile,
    parameters: Parameters,
    vehicle: Vehicle,
    policy: LossCheck,
    *,
    ground_station_received: bool,
    firmware: Firmware | None = None,
) -> list[Finding]:
    """Returns one finding for each rule of the autopilot, and for each other unknown parameter.

    policy: on an unsafe offboard loss. firmware: None if its version is unknown.
    """
    parameters = autopilot.with_silence(parameters)
    loss = autopilot.offboard_loss(parameters)
    if loss is None:
        return []
    case = judged_case(
        parameters, loss, vehicle, policy, ground_station_received=ground_station_received
    )
    rules = {rule.parameter: rule for rule in autopilot.rules}
    unread = _Unread(autopilot, parameters, firmware)
    found = [
        _judged(rule, case)
        if parameters.get(key) is not None
        else unread.finding(key, rule.unknown, rule.meaning)
        for key, rule in rules.items()
    ]
    return found + [
        unread.finding(key, Level.WARNING)
        for key in autopilot.flight_parameters
        if key not in rules and parameters[key] is None
    ]


def judged_case(
    parameters: Parameters,
    loss: OffboardLoss,
    vehicle: Vehicle,
    policy: LossCheck,
    *,
    ground_station_received: bool,
) -> Case:
    """Context in which the rules judge parameters."""
    speed = vehicle.speed
    return Case(
        parameters=parameters,
        loss=loss,
        objection=objection_level(policy),
        ground_station_received=ground_station_received,
        speeds_mps=(speed.horizontal_mps, speed.up_mps, speed.down_mps),
        max_speed_mps=speed.max_mps,
        acceleration_mps2=vehicle.guidance.acceleration_mps2,
        cells=vehicle.risk.cells,
        battery_full=vehicle.risk.battery_remaining.high,
    )


def _judged(rule: Rule, case: Case) -> Finding:
    value = case.parameters[rule.parameter]
    assert value is not None
    level, words = rule.judge(value, case)
    remedy = rule.remedy if isinstance(rule.remedy, str) else rule.remedy(case)
    return Finding(
        level=level,
        subject=case.parameters.called(rule.parameter).name,
        text=f"{words}: {rule.meaning}",
        remedy=remedy if level >= Level.WARNING else "",
    )


class _Unread:
    """Findings on parameters that were not reported."""

    def __init__(
        self, autopilot: Profile, parameters: Parameters, firmware: Firmware | None
    ) -> None:
        self._autopilot = autopilot
        self._parameters = parameters
        self._denying = autopilot.unreported(parameters).denying
        newest = ".".join(map(str, autopilot.newest_release))
        self._remedy = _NOT_REPORTED
        if firmware is not None and autopilot.is_newer(firmware):
            self._remedy = (
                f"{autopilot.name} {firmware} may have another name for it than {newest}, the "
                "newest that this program knows: update this program, or fly with that release"
            )

    def finding(self, key: str, level: Level, meaning: str = "") -> Finding:
        """Returns the finding. level: at least; a no-go if no inspection begins without it."""
        name = self._parameters.called(key).name
        others = self._autopilot.parameters.other_names(key, name)
        level = Level.NO_GO if name in self._denying else level
        words = [f"unknown, not reported{''.join(f', nor as {other}' for other in others)}"]
        words += [meaning] if meaning else []
        return Finding(
            level=level,
            subject=name,
            text=": ".join(words),
            remedy="" if level is Level.NOTE else self._remedy,
        )


class Preflight:
    """Machine of the preflight check. planner: of the site; None checks the aircraft alone.

    signing: needed if links are signed.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        planner: Planner | None,
        *,
        signing: Signing | None = None,
    ) -> None:
        self._limits = config.supervision
        self._vehicle = vehicle
        self._power = PowerModel.of(vehicle)
        self._planner = planner
        self._site = site = None if planner is None else planner.site
        self._session = Session(
            links={link.url: link.role for link in config.links},
            system_id=config.system_id,
            component_id=config.component_id,
            commands=config.commands,
            signing=link_signings(config.links, signing),
        )
        self._asked_links = [link.url for link in config.links if link.role is LinkRole.AUTOPILOT]
        self._pose_tracker = PoseTracker(site, vehicle.autopilot)
        self._risk = RiskEstimate.unknown(vehicle.risk)
        self._others: list[Autopilot] = []
        self._companion: ComponentConflict | None = None
        """Another sender with the companion's ids."""
        self._positions = self._attitudes = Arrivals()
        self._received_bytes = 0
        self._began_s: float | None = None
        self._found_s: float | None = None
        self._risk_due_s = -math.inf
        self._now_s = 0.0
        self._done = False

    @property
    def done(self) -> bool:
        """True if enough data was received, or none for too long."""
        return self._done

    @property
    def found(self) -> bool:
        """True if an autopilot was received, and so the aircraft was checked."""
        return self._session.telemetry.autopilot is not None

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes bytes from a link, split anywhere. address: their sender on a listening link."""
        before = self._session.telemetry
        self._received_bytes += len(data)
        self._session.receive(link, data, now_s, address)
        after = self._session.telemetry
        if after.local_position not in (None, before.local_position):
            self._positions = self._positions.another(now_s)
        if after.attitude not in (None, before.attitude):
            self._attitudes = self._attitudes.another(now_s)

    def tick(self, now_s: float) -> None:
        """Runs one cycle; to be called at 10 Hz or more."""
        self._now_s = now_s
        if self._began_s is None:
            self._began_s = now_s
        session = self._session
        session.tick(now_s, SystemStatus.STANDBY)
        for event in session.events_received():
            if isinstance(event, AutopilotConflict):
                self._others.append(event.other)
            elif isinstance(event, ComponentConflict):
                self._companion = event
        if session.autopilot is None:
            self._done = now_s - self._began_s >= WAIT_S
            return
        if self._found_s is None:
            self._found_s = now_s
            session.requests.want_parameters(profile(session.autopilot.kind).checked_parameters)
            session.requests.want_fence()
        self._pose_tracker.update(session.telemetry)
        if now_s >= self._risk_due_s:
            self._risk_due_s = now_s + _RISK_PERIOD_S
            self._risk = update(
                self._risk,
                session.telemetry,
                now_s,
                model=self._vehicle.risk,
                cruise_mps=self._vehicle.speed.horizontal_mps,
                power=self._power,
            )
        collected_s = now_s - self._found_s
        self._done = collected_s >= (_COLLECTION_S if self._is_complete() else _MAX_COLLECTION_S)

    def data_to_send(self) -> list[tuple[str, bytes]]:
        """Returns the packets since the last call, in order, each with its link's name."""
        return self._session.data_to_send()

    def peers(self, link: str) -> tuple[Address, ...]:
        """Addresses to which a listening link sends; empty for other links."""
        return self._session.peers(link)

    def findings(self) -> list[Finding]:
        """Returns the findings, once `done`."""
        session, parameters = self._session, self._session.requests.parameters
        autopilot, status = session.autopilot, session.telemetry.autopilot
        if autopilot is None or status is None:
            return [self._silence(), *self._refusals()]
        received = ReceivedData(
            autopilot=autopilot,
            status=status,
            others=tuple(self._others),
            telemetry=session.telemetry,
            risk=self._risk,
            positions=self._positions.until(self._now_s),
            attitudes=self._attitudes.until(self._now_s),
            pose=self._pose_tracker.pose,
            causes=self._causes(),
        )
        known = profile(autopilot.kind)
        return [
            *self._refusals(),
            *self._other_companion(),
            *aircraft_findings(received, self._vehicle, self._site, self._limits),
            *parameter_findings(
                known,
                parameters,
                self._vehicle,
                self._limits.loss_action,
                ground_station_received=session.telemetry.ground_station is not None,
                firmware=session.telemetry.firmware,
            ),
            *self._fence(known),
            held_wind_finding(autopilot.kind, parameters, self._vehicle, self._limits),
            *self._offboard_loss(known),
            *self._failsafes(known),
        ]

    def _other_companion(self) -> Iterator[Finding]:
        other = self._companion
        if other is not None:
            yield Finding(
                level=Level.WARNING,
                subject="companion",
                text=f"another sender has the ids {other.system_id} and {other.component_id}",
                remedy="the running service: then all is well; a second companion: stop it, or "
                "give it another `component_id`",
            )

    def _causes(self) -> dict[str, str]:
        """Returns the service's reasons against a flight now."""
        seen = CheckInputs(
            telemetry=self._session.telemetry,
            risk=self._risk,
            pose=self._pose_tracker.pose,
            position_moved_s=self._pose_tracker.position_moved_s,
            azimuth_rad=None if self._site is None else math.radians(self._site.frame.azimuth_deg),
        )
        off_path_m = self._vehicle.guidance.off_path_m
        return causes(Look(seen, self._limits, off_path_m, self._now_s))

    def _fence(self, autopilot: Profile) -> list[Finding]:
        requests = self._session.requests
        readiness, items = self._session.telemetry.readiness, requests.fence_items
        fence = autopilot.fence(
            autopilot.with_silence(requests.parameters),
            items or (),
            enabled=readiness is not None and readiness.fence_enabled,
        )
        if fence is None:
            return []
        return fence_findings(
            self._planner,
            fence,
            self._pose_tracker.home_m,
            self._limits.fence_margin_m,
            reported=items is not None,
        )

    def _offboard_loss(self, autopilot: Profile) -> list[Finding]:
        loss = autopilot.offboard_loss(autopilot.with_silence(self._session.requests.parameters))
        if self._planner is None or loss is None:
            return []
        home_m = self._pose_tracker.home_m
        return loss_findings(self._planner, loss, home_m, self._limits.loss_action)

    def _failsafes(self, autopilot: Profile) -> list[Finding]:
        failsafes = autopilot.failsafes(autopilot.with_silence(self._session.requests.parameters))
        if self._planner is None or failsafes is None:
            return []
        failsafes = replace(failsafes, home_m=self._pose_tracker.home_m)
        return failsafe_findings(self._planner, failsafes, self._limits, self._power)

    def _is_complete(self) -> bool:
        """True if no requested data may still come."""
        session = self._session
        assert session.autopilot is not None
        requests = session.requests
        fence_known = requests.fence_items is not None or requests.fence_silent
        known = session.telemetry.firmware is not None and fence_known
        return known and all(
            name in requests.parameters
            for name in profile(session.autopilot.kind).checked_parameters
        )

    def _refusals(self) -> list[Finding]:
        """Returns findings on packets that the signed links have refused."""
        behind = [
            Finding(
                level=Level.WARNING,
                subject="signing",
                text=f"{link}: system {system_id} signs {seconds:.0f} s behind, refused",
                remedy="set its clock and this computer's",
            )
            for link, signers in self._session.signing.behind_s.items()
            for system_id, seconds in signers.items()
        ]
        return behind + [
            Finding(
                level=Level.WARNING,
                subject="signing",
                text=f"{link}: {count} packets refused, {reason.value}",
                remedy=_REFUSAL_REMEDIES[reason],
            )
            for link, counts in self._session.signing.packets_refused.items()
            for reason, count in counts.items()
            if count
        ]

    def _silence(self) -> Finding:
        """Returns the finding of a missing autopilot, with hints at the cause."""
        links = ", ".join(self._asked_links)
        if self._received_bytes == 0:
            remedy = (
                "check that it runs and sends to this port (on a serial line: the right device, "
                "TX and RX crossed, MAVLink set up on that port)"
            )
        else:
            remedy = (
                f"{self._received_bytes} bytes received, but no heartbeat of an autopilot: check "
                "the baud rate, the protocol (MAVLink) and the sender"
            )
        return Finding(
            level=Level.NO_GO,
            subject="autopilot",
            text=f"none received on {links} for {WAIT_S:g} s",
            remedy=remedy,
        )
