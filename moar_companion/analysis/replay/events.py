"""Events of a recording: messages, and changes of telemetry. No I/O."""

from __future__ import annotations

from ...companion.mission_states import MissionState
from ...mavlink.commands import Command, DeniedCommand, MissionCommand, PauseContinue
from ...mavlink.identity import AutopilotConflict, AutopilotFound, AutopilotRestarted
from ...mavlink.passive_listener import AnswerReceived, ListenerEvent, TextReceived
from ...mavlink.telemetry import AutopilotStatus, Battery, Gnss, Telemetry
from ...risk.battery import WARNINGS
from ...risk.explain import rise_words
from ...risk.indices import IndexReport
from ...risk.power import is_powered
from .replay_report import ReplayEvent

SILENCE_S = 3.0
"""Three missed heartbeats: the autopilot is silent."""
_TWICE_S = 1.0
"""A message that was sent over two links is in a recording twice."""
_SAME_TEXT_S = 10.0
"""Minimum time between two events with the same text."""
_FIX_3D = 3
_RISK_HIGH, _RISK_LOW = 0.6, 0.3
"""Index reports begin at a high value, and repeat only after a low one. High is above the value of
an index without inputs."""
_MISSION_WORD = "MOAR: "
"""Prefix of the companion's texts, which begin or end with a state: `holding`, `at target A`."""


class EventLog:
    """Events in order of time; `now_s` is set before each call.

    battery_low: the fraction left at which a battery without a charge state counts as low.
    """

    def __init__(self, *, battery_low: float) -> None:
        self.now_s = 0.0
        self.events: list[ReplayEvent] = []
        self.mission_state: str | None = None
        """The state that the companion last reported."""
        self.silent = False
        """True while no message of the autopilot arrives."""
        self._battery_low = battery_low
        self._fix: bool | None = None
        self._had_fix = False
        self._battery_words: dict[int, str] = {}
        self._reported_s: dict[tuple[str, str], float] = {}
        self._high: set[str] = set()

    def report(self, kind: str, text: str, *, again_after_s: float = 0.0) -> None:
        """Adds an event, unless the same was added less than `again_after_s` ago."""
        reported_s = self._reported_s.get((kind, text))
        if reported_s is None or self.now_s - reported_s >= again_after_s:
            self._reported_s[kind, text] = self.now_s
            self.events.append(ReplayEvent(time_s=self.now_s, kind=kind, text=text))

    def watch_link(self, telemetry: Telemetry) -> None:
        """Adds an event when the autopilot becomes silent or is received again."""
        if telemetry.link is None:
            return
        silent = self.now_s - telemetry.link.received_s > SILENCE_S
        if silent and not self.silent:
            self.report("link", "the autopilot is not received")
        elif self.silent and not silent:
            self.report("link", "the autopilot is received again")
        self.silent = silent

    def watch_risk(self, name: str, value: float, report: IndexReport) -> None:
        """Adds an event, with its cause, when measurements make an index high."""
        if name in self._high:
            if value < _RISK_LOW:
                self._high.remove(name)
        elif min(value, report.target) >= _RISK_HIGH and report.cause is not None:
            self._high.add(name)
            self.report("risk", rise_words(name, report))

    def take(self, event: ListenerEvent) -> None:
        """Adds an event for a message that the listener received."""
        if isinstance(event, AutopilotFound):
            found = event.autopilot
            self.report("autopilot", f"{found.kind}, system {found.system_id}")
        elif isinstance(event, AutopilotRestarted):
            self.report("autopilot", "restarted")
        elif isinstance(event, AutopilotConflict):
            other = event.other
            self.report("autopilot", f"a second one: {other.kind}, system {other.system_id}")
        elif isinstance(event, TextReceived):
            self._take_text(event)
        elif isinstance(event, AnswerReceived):
            answer = event.result.name.replace("_", " ").lower()
            self.report("answer", answer, again_after_s=_TWICE_S)
        else:
            sender = f"from {event.sender.system_id}/{event.sender.component_id}"
            self.report("order", f"{_order_words(event)} {sender}", again_after_s=_TWICE_S)

    def _take_text(self, event: TextReceived) -> None:
        text = event.text.text
        state = _mission_state(text) if event.ours else None
        if state is not None:
            self.mission_state = state.value
            self.report("mission", text.removeprefix(_MISSION_WORD), again_after_s=_TWICE_S)
            return
        speaker = "companion" if event.ours else "autopilot"
        self.report("text", f"{speaker} {event.text.severity}: {text}", again_after_s=_SAME_TEXT_S)

    def compare(self, before: Telemetry, after: Telemetry) -> None:
        """Adds events for the changes of telemetry by one message."""
        if after.autopilot is not None and after.autopilot is not before.autopilot:
            self._compare_status(before.autopilot, after.autopilot)
        if after.gnss is not None and after.gnss is not before.gnss:
            self._compare_fix(after.gnss)
        if after.batteries is not before.batteries:
            for number, battery in after.batteries.items():
                if battery is not before.batteries.get(number):
                    self._compare_battery(number, battery)

    def _compare_status(self, before: AutopilotStatus | None, after: AutopilotStatus) -> None:
        if before is None or before.mode != after.mode:
            self.report("mode", after.mode)
        if after.armed != (before is not None and before.armed):
            self.report("armed", "armed" if after.armed else "disarmed")
        if after.failsafe != (before is not None and before.failsafe):
            self.report("failsafe", "failsafe" if after.failsafe else "failsafe over")

    def _compare_fix(self, gnss: Gnss) -> None:
        fix = gnss.fix_type >= _FIX_3D
        if fix != self._fix:
            found = "3D fix again" if self._had_fix else "3D fix"
            lost = "3D fix lost" if self._had_fix else "no 3D fix"
            self.report("gps", found if fix else lost)
        self._fix = fix
        self._had_fix = self._had_fix or fix

    def _compare_battery(self, number: int, battery: Battery) -> None:
        """Compares the autopilot's charge state; the fraction left where it never reports one."""
        if not is_powered(battery):
            return
        known = self._battery_words.get(number, "")
        word = WARNINGS.get(battery.charge_state or 0, "")
        if battery.charge_state is None:
            if battery.remaining is None or (known and not known.startswith("at ")):
                return
            low = self._battery_low
            word = f"at {low:.0%}" if battery.remaining <= low else ""
        if word != known:
            self.report("battery", f"battery {number} {word or 'no longer low'}")
        self._battery_words[number] = word


def _mission_state(text: str) -> MissionState | None:
    """The state that a text of the companion reports; None if it reports none."""
    if not text.startswith(_MISSION_WORD):
        return None
    words = text.removeprefix(_MISSION_WORD)
    action = words.rpartition(", ")[2]
    return next(
        (
            state
            for state in MissionState
            if action == state.words or f"{words} ".startswith(f"{state.words} ")
        ),
        None,
    )


def _order_words(order: Command) -> str:
    if isinstance(order, MissionCommand):
        index = "" if order.index is None else f" {order.index}"
        return f"{getattr(order.mission, 'value', order.mission)}{index}"
    if isinstance(order, PauseContinue):
        return "pause" if order.pause else "continue"
    return order.reason if isinstance(order, DeniedCommand) else f"command {order.command}"
