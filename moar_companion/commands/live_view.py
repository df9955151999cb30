"""The live view: a status as a page for the terminal, or as one line of text.

Input: the status as the view socket sends it (`status_values`). Pure; the page is a rich
renderable that fits itself to the width and height it is drawn in, from 80 x 24 up.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime, timezone
from typing import Any

from rich.columns import Columns
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.measure import Measurement
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from ..texts.text_format import printable

_UNKNOWN = "unknown"
_WIDE = 120
"""From this width the risks stand beside the rest, else below it."""
_LEFT_WIDTH = 52
"""Least width of the rest beside the risks."""
_MOST_INPUTS = (100, 8, 4, 2, 0)
"""Numbers of inputs shown of each index, the gravest ones; the first one with which the page fits
its terminal. With 0 the deciding one stands beside the bar, and most rows are one line."""
_SHORT = 34
"""Height below which no input has a line of its own."""
_LABEL_WIDTH = 14
_BAR_WIDTH, _SHORT_BAR_WIDTH = 20, 12
"""The short bar: risks on half a page, each beside its deciding input."""
_HIGH, _VERY_HIGH = 0.5, 0.8
"""Risk indices from which a bar or a number is yellow, and red."""
_MOST_SET = 3
"""Parameters on one line of half a page."""
_SILENT_S = 2.0
"""The service sends four statuses a second: after this it counts as silent."""
STATE_STYLES = {
    "flying": "bold green",
    "at_target": "bold green",
    "landing_leg": "bold green",
    "holding": "bold green",
    "overridden": "bold yellow",
    "released": "bold red",
}

_VITAL = ("local_position", "attitude", "gnss", "battery")
"""Sources whose age is shown where there is room for one line."""

Status = dict[str, Any]
Row = tuple[str, RenderableType]


class LiveView:
    """The page. notes: further lines, the last ones at the bottom; silent_s: status age."""

    def __init__(self, status: Status, *, notes: Sequence[str] = (), silent_s: float = 0.0) -> None:
        self._status = status
        self._notes = notes
        self._silent_s = silent_s

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        free, height = options.reset_height(), options.size.height
        short = options.is_terminal and height < _SHORT
        for most in _MOST_INPUTS[-1:] if short else _MOST_INPUTS:
            page = Group(*self._page(console, options, most))
            if not options.is_terminal or len(console.render_lines(page, free)) <= height:
                break
        yield page

    def _page(
        self, console: Console, options: ConsoleOptions, most_inputs: int
    ) -> Iterator[RenderableType]:
        status, full = self._status, most_inputs > 0
        wide = options.max_width >= _WIDE
        bar_width = _SHORT_BAR_WIDTH if wide and not full else _BAR_WIDTH
        risk = _risk(status, most_inputs=most_inputs, bar_width=bar_width)
        state = _rows([*_mission(status), *_aircraft(status)], wrap=full or wide)
        work = _rows(_work(status, full=full), wrap=full)
        yield _head(status, silence_of(self._silent_s))
        if full or wide:
            yield Rule(style="dim")
        if wide:
            # Text at the left can be wrapped; names of inputs cannot.
            needed = Measurement.get(console, options, risk).maximum
            columns = Table.grid(expand=True, padding=(0, 2))
            columns.add_column(ratio=1)
            columns.add_column(
                width=min(max(options.max_width // 2, needed), options.max_width - _LEFT_WIDTH)
            )
            columns.add_row(Group(state, Text(), work), risk)
            yield columns
        else:
            gap = [Text()] if full else []
            yield Group(state, *gap, risk, *gap, work)
        if self._notes:
            yield Rule(style="dim")
            yield from (Text(printable(note), no_wrap=True) for note in self._notes)


def silence_of(silent_s: float) -> str | None:
    """Text for a service that is silent; None while it sends."""
    return f"no data from the service for {silent_s:.0f} s" if silent_s >= _SILENT_S else None


def line_of(status: Status) -> str:
    """Summary of a status in one line."""
    mission, aircraft, path = status["mission"], status["aircraft"], status["path"]
    words = [
        _clock(status),
        _doing(mission),
        f"mode {_of(status['autopilot'], 'mode')}",
        f"at {_place(aircraft['position_m'])}",
        f"{_number(aircraft['speed_mps'], 1)} m/s",
        f"clearance {_number(aircraft['clearance_m'], 2, ' m')}",
    ]
    if path is not None:
        words.append(f"{path['left_m']:.1f} m left")
    risks = (
        f"{name} {risk['value']:.2f}{'' if risk['known'] else ' (unknown)'}"
        for name, risk in status["risk"].items()
    )
    return printable(", ".join([*words, f"risks: {', '.join(risks)}"]))


def _head(status: Status, silence: str | None) -> Table:
    """Autopilot, mode and time of the status; for a silent service its silence instead."""
    autopilot = status["autopilot"]
    words = Text("moar-companion", style="bold")
    if silence is not None:
        words.append(f"   {silence}", style="bold red")
    elif autopilot is None:
        words.append("   no autopilot is received", style="bold red")
    else:
        words.append(
            f"   {printable(autopilot['kind'])}, system {autopilot['system_id']}   ", "dim"
        )
        words.append(printable(autopilot["mode"]), "bold green" if autopilot["ours"] else "bold")
        words.append(", armed" if autopilot["armed"] else ", disarmed")
        if autopilot["failsafe"]:
            words.append("   FAILSAFE", "bold red")
        if autopilot["age_s"] > _SILENT_S:
            words.append(f"   silent for {autopilot['age_s']:.0f} s", "bold red")
    table = Table.grid(expand=True)
    table.add_column(no_wrap=True)
    table.add_column(justify="right", no_wrap=True)
    alarm = autopilot is not None and (autopilot["failsafe"] or autopilot["age_s"] > _SILENT_S)
    table.add_row(words, Text("" if alarm else _clock(status), style="dim"))
    return table


def _mission(status: Status) -> Iterator[Row]:
    mission = status["mission"]
    words = Text.assemble((_doing(mission), STATE_STYLES.get(mission["state"], "bold")))
    if mission["for_s"] is not None:
        words.append(f" for {_duration(mission['for_s'])}")
    yield "mission", words
    if mission["text"] is not None:
        last = Text(printable(mission["text"]))
        last.append(f"   {_duration(mission['text_age_s'])} ago", "dim")
        yield "last text", last


def _aircraft(status: Status) -> Iterator[Row]:
    aircraft, path = status["aircraft"], status["path"]
    clearance = _known(aircraft["clearance_m"], 2, " m")
    yield (
        "aircraft",
        Text.assemble(
            _known(aircraft["speed_mps"], 2, " m/s"),
            f", {(aircraft['landed'] or 'landed or not ' + _UNKNOWN).replace('_', ' ')}",
            ("   clearance ", "dim"),
            clearance,
        ),
    )
    yield (
        "position",
        Text.assemble(
            _place(aircraft["position_m"]),
            ("   NED ", "dim"),
            _place(aircraft["position_ned_m"], names=("", "", "")),
        ),
    )
    refused = _refused_setpoint(status.get("gate"))
    if path is None:
        yield "setpoint", Text("none is sent", style="dim").append_text(refused)
        yield "path", Text("none", style="dim")
        return
    yield "setpoint", Text(_place(path["setpoint"]["position_m"])).append_text(refused)
    yield (
        "path",
        Text.assemble(
            ("error ", "dim"),
            f"{path['error_m']:.2f} m",
            ("   left ", "dim"),
            f"{path['left_m']:.1f} m, {_duration(path['left_s'])}",
        ),
    )


def _refused_setpoint(gate: Status | None) -> Text:
    """The last action of the setpoint gate; empty before the first."""
    if gate is None:
        return Text()
    words = f"{gate['action']} {_duration(gate['age_s'])} ago: {printable(gate['reason'])}"
    return Text.assemble(("   gate ", "dim"), words)


def _risk(status: Status, *, most_inputs: int, bar_width: int) -> RenderableType:
    """A bar for each index with its deciding input, or with its gravest inputs; the weights."""
    parts: list[RenderableType] = []
    for name, index in status["risk"].items():
        bar = _bar(index, bar_width, decided_by=not most_inputs)
        parts.append(_rows([(name, bar)], wrap=False))
        if most_inputs:
            parts.append(_inputs(index, most_inputs))
    parts.append(_rows([("weights", _weights(status["weights"]))], wrap=most_inputs > 0))
    return Group(*parts)


def _inputs(index: Status, most: int) -> RenderableType:
    """Risk, name, value and age of an index's gravest inputs; the deciding one is highlighted.

    The gravest: the deciding one, those of the greatest risk, then those without a measurement.
    """
    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(width=2)
    table.add_column(width=7, justify="right", no_wrap=True)
    table.add_column(ratio=1, no_wrap=True)
    table.add_column(width=10, justify="right", no_wrap=True)
    table.add_column(width=12, no_wrap=True)

    def gravity(item: Status) -> tuple[bool, float]:
        return item["name"] == index["worst"], -1.0 if item["risk"] is None else item["risk"]

    gravest = sorted(index["inputs"], key=gravity, reverse=True)[:most]
    for item in (each for each in index["inputs"] if each in gravest):
        received, known = item["age_s"] is not None, item["risk"] is not None
        table.add_row(
            "",
            Text(f"{item['risk']:.2f}" if known else _UNKNOWN, "" if known else "magenta"),
            printable(item["name"]),
            item["reading"] if received else "",
            f"{_duration(item['age_s'])} ago" if received else "no data",
            style="" if item["name"] == index["worst"] else "dim",
        )
    return table


def risk_style(value: float) -> str:
    """Colour of a known risk index."""
    return "red" if value >= _VERY_HIGH else "yellow" if value >= _HIGH else "green"


def _bar(index: Status, width: int, *, decided_by: bool) -> Text:
    value = index["value"]
    style = risk_style(value)
    full = round(value * width)
    words = Text.assemble(
        ("█" * full, style if index["known"] else "magenta"),
        ("░" * (width - full), "dim"),
        (f" {value:.2f}", "bold"),
    )
    worst = next((item for item in index["inputs"] if item["name"] == index["worst"]), None)
    if not index["known"]:
        words.append("   unknown", "magenta")
    elif decided_by and worst is not None:
        words.append(f"   {printable(worst['name'])} {worst['reading']}", "dim")
        if worst["age_s"] > _SILENT_S and worst["unit"] != "s":
            words.append(f", {_duration(worst['age_s'])} ago", "dim")
    return words


def _weights(weights: Status) -> Text:
    base, adjusted = weights["base"], weights["adjusted"]
    words = Text()
    for name, value in adjusted.items():
        words.append(f"{name} {base[name]:.2f}→", "dim")
        words.append(f"{value:.2f}  ", "bold")
    return words


def _work(status: Status, *, full: bool) -> Iterator[Row]:
    """Rows of the last plan, the link, the ages of received data, the record."""
    yield "plan", _plan(status["plan"])
    ages = status["age_s"]
    yield "link", _link(status["link"], ages["ground_station"])
    if status.get("refused"):
        yield "signed", _signed(status["refused"])
    yield "radio", Text(_radio(status["radio"]))
    if status.get("perception"):
        yield "seen", _perception(status["perception"])
        if (line := status["perception"].get("line")) is not None:
            yield "line", _line(line)
    if status.get("inspection"):
        yield "pictures", _pictures(status["inspection"])
    shown = ages if full else {name: ages[name] for name in _VITAL}
    received_ago = [_age(name, age_s) for name, age_s in shown.items()]
    yield "data age, s", Columns(received_ago) if full else Text("  ").join(received_ago)
    if full and status.get("parameters"):
        yield "set", Text(_parameters(status["parameters"]))
    if status["recorder"] is not None:
        yield "record", Text(printable(status["recorder"]))


def _parameters(values: Mapping[str, float]) -> str:
    """Parameters that were set in flight; of many the first ones."""
    shown = ", ".join(f"{name} {value:g}" for name, value in list(values.items())[:_MOST_SET])
    more = len(values) - _MOST_SET
    return f"{shown} and {more} more" if more > 0 else shown


def _age(source: str, age_s: float | None) -> Text:
    age = ("no data", "dim") if age_s is None else (f"{age_s:.1f}", "")
    return Text.assemble((f"{source.replace('_', ' ')} ", "dim"), age)


def _plan(plan: Status | None) -> Text:
    if plan is None:
        return Text("none yet", style="dim")
    words = Text(f"cost {plan['cost']['total']:.2f}, {plan['search_ms']:.1f} ms, ")
    words.append(f"{_duration(plan['age_s'])} ago; reason: {printable(plan['reason'])}")
    if plan["change"] is not None:
        words.append(f"; {printable(plan['change'])}")
    words.append(f"; {plan['paths']} paths, {plan['replans']} replans", "dim")
    return words


def _link(link: Status | None, ground_station_age_s: float | None) -> Text:
    if link is None:
        return Text(_UNKNOWN, style="magenta")
    words = Text(f"{_number(link['rate_hz'], 0, ' packets/s')}, {link['packets_lost']} lost")
    if ground_station_age_s is None:
        return words.append("; no ground station is received")
    return words.append(f"; ground station received {_duration(ground_station_age_s)} ago")


def _signed(refused: Mapping[str, Mapping[str, int]]) -> Text:
    """Packets that the signed links have refused, summed over the links."""
    counts = Counter[str]()
    for reasons in refused.values():
        counts.update(reasons)
    words = ", ".join(f"{count} {reason}" for reason, count in counts.items() if count)
    return Text.assemble("refused ", (words, "bold") if words else "none")


def _perception(seen: Status) -> Text:
    """Number of seen obstacles, and the state of the sensor."""
    words = Text(f"{len(seen['conductors'])} conductors, {seen['solids']} other obstacles; ")
    if seen["refusal"] is not None:
        words.append(f"packets {seen['refusal']}; ", "magenta")
    age_s = seen["scan_age_s"]
    if age_s is None:
        return words.append("no scan yet", "magenta")
    words.append(f"scan {_duration(age_s)} ago, {seen['returns']:.0%} of beams")
    return words.append(f"; {seen['refused']} packets refused, {seen['late']} scans late", "dim")


def _pictures(inspection: Status) -> Text:
    """Confirmed pictures, the view that is captured, and what could not be."""
    words = Text(f"{inspection['pictures']} of {inspection['of']}")
    if inspection["view"] is not None:
        words.append(f"; {inspection['view']} {inspection['phase']}")
    if inspection["reason"] is not None:
        words.append(f": {printable(inspection['reason'])}", "magenta")
    if inspection["failed"]:
        words.append(f"; not captured: {', '.join(inspection['failed'])}", "magenta")
    camera = printable(inspection["camera"] or "no camera so far")
    return words.append(f"; {camera}, gimbal {inspection['gimbal']}", "dim")


def _line(line: Status) -> Text:
    """Where the line shows that the aircraft is, from the autopilot's estimate."""
    if line["age_s"] is None:
        return Text("not known by its wires", style="dim")
    x_m, z_m = line["offset_m"]
    x_m2, _, z_m2 = line["covariance_m2"]
    heading_deg = math.degrees(line["heading_offset_rad"])
    words = Text(f"{x_m:+.2f} m, up {z_m:+.2f} m, heading {heading_deg:+.0f}°; ")
    words.append(f"to {max(x_m2, z_m2) ** 0.5:.2f} m")
    return words.append(f" by {line['wires']} wires, {_duration(line['age_s'])} ago", "dim")


def _radio(radio: Status | None) -> str:
    if radio is None:
        return "no data"
    return (
        f"{radio['kind']}: {_number(radio['rssi'], 0)} over {_number(radio['noise'], 0)} here, "
        f"{_number(radio['remote_rssi'], 0)} over {_number(radio['remote_noise'], 0)} there"
    )


def _rows(rows: Iterable[Row], *, wrap: bool) -> RenderableType:
    """Rows of a label and its content; without `wrap` each is one line."""
    table = Table.grid(expand=True)
    table.add_column(width=_LABEL_WIDTH, no_wrap=True, style="cyan")
    table.add_column(ratio=1, no_wrap=not wrap, overflow="fold" if wrap else "ellipsis")
    for label, content in rows:
        table.add_row(label, content)
    return table


def _doing(mission: Status) -> str:
    """State, mission and goal as text."""
    words = [mission["state"].replace("_", " ")]
    if mission["mission"] is not None:
        words.append(mission["mission"])
    if isinstance(mission["goal"], str):
        words.append(f"of {mission['goal']}")
    elif mission["goal"] is not None:
        words.append(f"to landing point {mission['goal']}")
    return printable(" ".join(words))


def _place(
    place_m: Sequence[float] | None, *, names: tuple[str, str, str] = ("x ", "y ", "z ")
) -> str:
    if place_m is None:
        return _UNKNOWN
    numbers = (
        f"{name}{round(part, 2) + 0.0:.2f}" for name, part in zip(names, place_m, strict=True)
    )
    return "  ".join(numbers) + " m"


def _number(value: float | None, digits: int, unit: str = "") -> str:
    return _UNKNOWN if value is None else f"{value:.{digits}f}{unit}"


def _known(value: float | None, digits: int, unit: str) -> tuple[str, str]:
    """A number with its style; unknown is highlighted."""
    return _number(value, digits, unit), "magenta" if value is None else "bold"


def _duration(seconds: float) -> str:
    if seconds < 60.0:
        return f"{seconds:.1f} s" if seconds < 10.0 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s"


def _clock(status: Status) -> str:
    return f"{datetime.fromtimestamp(status['time_s'], tz=timezone.utc):%H:%M:%S} UTC"


def _of(section: Status | None, key: str) -> str:
    return _UNKNOWN if section is None else str(section[key])
