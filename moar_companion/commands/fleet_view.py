"""The fleet as a table for the terminal, a row per vehicle, or as lines of text. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.console import Console, ConsoleOptions, RenderResult
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from ..service.mqtt.fleet import Row
from ..service.mqtt.payloads import BatteryPayload, Conditions, Energy, MissionPayload, Risk
from ..texts.text_format import printable
from .live_view import STATE_STYLES, risk_style

_UNKNOWN = "?"
_LOW, _VERY_LOW = 0.4, 0.25
"""Fractions of the charge below which it is yellow, and red."""
_SOON_S = 60.0
"""Flight time after the better escape route below which it is red."""
_SILENT_S, _OLD_S = 5.0, 60.0
"""Ages from which a number is yellow, and red: the position comes twice a second."""
_NAME_WIDTH, _MODE_WIDTH = 20, 10
_OTHER_LINES = 5
"""Lines of a screen that are no rows."""
_RISKS = ("wind", "communication", "localization", "battery")

Cell = tuple[str, str]
"""Text and style."""


class FleetView:
    """The table. head: about the connection; now_s, wall_s: the receiver's clocks."""

    def __init__(self, rows: Sequence[Row], head: str, *, now_s: float, wall_s: float) -> None:
        self._rows = rows
        self._head = head
        self._now_s = now_s
        self._wall_s = wall_s

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield Text.assemble(("moar-companion", "bold"), f"   {printable(self._head)}")
        yield Rule(style="dim")
        table = Table(box=None, expand=True, pad_edge=False, header_style="cyan")
        table.add_column("vehicle", no_wrap=True, max_width=_NAME_WIDTH)
        table.add_column("state", no_wrap=True, ratio=3)
        table.add_column("mode", no_wrap=True, max_width=_MODE_WIDTH)
        for name in ("wind", "comm", "loc", "batt"):
            table.add_column(name, justify="right", no_wrap=True)
        table.add_column("charge", justify="right", no_wrap=True)
        table.add_column("reserve", justify="right", no_wrap=True)
        table.add_column("conditions", no_wrap=True, ratio=2)
        table.add_column("age", justify="right", no_wrap=True)
        room = len(self._rows)
        if options.is_terminal:
            room = max(1, options.size.height - _OTHER_LINES)
        for row in self._rows[:room]:
            cells = _cells(row, row.age_s(self._now_s, self._wall_s))
            table.add_row(*(Text(text, style=style) for text, style in cells))
        yield table
        left_out = len(self._rows) - room
        if left_out > 0:
            yield Text(f"and {left_out} more: a taller window shows them", style="dim")


def lines_of(rows: Sequence[Row], *, now_s: float, wall_s: float) -> Iterator[str]:
    """A line of text for each vehicle."""
    names = ("", "", "", *_RISKS, "charge", "reserve", "", "age")
    for row in rows:
        cells = _cells(row, row.age_s(now_s, wall_s))
        titled = zip(names, (text for text, _ in cells), strict=True)
        yield ", ".join(f"{name} {text}".strip() for name, text in titled if text)


def _cells(row: Row, age_s: float | None) -> Iterator[Cell]:
    mission, risk = row.payloads.get("mission"), row.payloads.get("risk")
    battery, energy = row.payloads.get("battery"), row.payloads.get("energy")
    conditions = row.payloads.get("conditions")
    yield printable(row.vehicle), "bold" if row.online else "dim"
    yield _state(row, mission)
    yield _mode(mission)
    for name in _RISKS:
        yield _index(risk, name)
    yield _charge(battery)
    yield _after_exit(energy)
    yield _conditions(conditions)
    yield _age(age_s)


def _state(row: Row, mission: MissionPayload | None) -> Cell:
    if row.online is False:
        was = "" if mission is None else f", was {_doing(mission)}"
        return f"offline{was}", "bold red"
    if mission is None:
        return _UNKNOWN, "magenta"
    return _doing(mission), STATE_STYLES.get(mission.state, "")


def _doing(mission: MissionPayload) -> str:
    words = [mission.state.replace("_", " "), mission.mission or ""]
    if isinstance(mission.target, str):
        words.append(mission.target)
    elif mission.target is not None:
        words.append(f"to {mission.target}")
    return printable(" ".join(filter(None, words)))


def _mode(mission: MissionPayload | None) -> Cell:
    if mission is None or mission.mode is None:
        return _UNKNOWN, "magenta"
    return printable(mission.mode), "" if mission.armed else "dim"


def _index(risk: Risk | None, name: str) -> Cell:
    if risk is None:
        return _UNKNOWN, "magenta"
    index = getattr(risk.risk, name)
    if not index.known:
        return f"{index.value:.2f}?", "magenta"
    return f"{index.value:.2f}", risk_style(index.value)


def _charge(battery: BatteryPayload | None) -> Cell:
    if battery is None or battery.remaining is None:
        return _UNKNOWN, "magenta"
    left = battery.remaining
    style = "bold red" if left < _VERY_LOW else "yellow" if left < _LOW else ""
    return f"{100.0 * left:.0f} %", style


def _after_exit(energy: Energy | None) -> Cell:
    """Flight time left after the better escape route."""
    route = None if energy is None or energy.better is None else getattr(energy, energy.better)
    if route is None or route.left_s is None:
        return _UNKNOWN, "magenta"
    minutes, seconds = divmod(round(abs(route.left_s)), 60)
    sign = "-" if route.left_s < 0.0 else ""
    return f"{sign}{minutes}:{seconds:02d}", "bold red" if route.left_s < _SOON_S else ""


def _conditions(conditions: Conditions | None) -> Cell:
    if conditions is None:
        return _UNKNOWN, "magenta"
    if not conditions.conditions:
        return "", ""
    reasons = "; ".join(item.reason for item in conditions.conditions)
    calm = conditions.action == "continue"
    action = "" if calm else f"{conditions.action}: "
    return printable(f"{action}{reasons}"), "" if calm else "yellow"


def _age(age_s: float | None) -> Cell:
    if age_s is None:
        return _UNKNOWN, "magenta"
    style = "bold red" if age_s >= _OLD_S else "yellow" if age_s >= _SILENT_S else ""
    if age_s < 100.0:
        return f"{age_s:.1f} s", style
    hours, minutes = divmod(round(age_s / 60.0), 60)
    return (f"{hours} h {minutes} min" if hours else f"{minutes} min"), style
