"""The picture of a replay: the four indices over time, below events and flight modes.

From top to bottom: events, flight modes, the mission's states where there are any, and one panel
for each index. Where a site is known, the clearance follows. Unknown values are hatched, never
drawn as 0.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import IO, Any

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.patches import Patch
from matplotlib.textpath import TextPath

from ..replay.replay_report import Replay, ReplayEvent, ReplaySample
from .figure import DPI, INK, Page, page_style

_COLOURS = {
    "wind": "#1f77b4",
    "communication": "#9467bd",
    "localization": "#2ca02c",
    "battery": "#d62728",
}
_CLEARANCE = "#8c6d31"
_ARMED = "#fff3d1"
_UNKNOWN = "#bdbdbd"
_HELD = "#e9e9e9"
_SPANS = ("#dfe6ee", "#c9d5e3")
_UNKNOWN_SPAN = "#f4f4f4"
_KINDS = {
    "failsafe": "#c1121f",
    "armed": "#7a5c00",
    "mission": "#33527a",
    "mode": "#33527a",
    "link": "#9467bd",
    "battery": "#d62728",
    "gps": "#2ca02c",
    "risk": "#b35c00",
    "autopilot": INK,
    "recording": "#555555",
    "order": "#0a58a8",
    "answer": "#0a58a8",
    "text": "#555555",
}
"""Kinds of events that are named, the most important first, with their colours."""
_BANDS: dict[str, Callable[[ReplaySample], str | None]] = {
    "mission": lambda sample: sample.mission_state,
    "mode": lambda sample: sample.mode,
}
"""Bands by the kind of their events, from below; too short a span is named as an event."""
_AUTOPILOT = "autopilot "
"""Prefix of the autopilot's texts, which are the majority."""
_QUIET_TEXTS = ("info:", "debug:", "notice:")
"""Severities that are not named in the picture."""
_LONGEST_LABELS = (80, 34)
"""Characters; the shorter one where the longer has no room."""
_LONGEST_NAME = 60
_LABEL_SIZE = 7.0
_FONT = FontProperties(family="DejaVu Sans")
_FONT_UNIT = 10.0
_PAD = 0.004
"""Distance between a line and its text, as part of the time axis."""
_LANES = 12
_SAMPLE_S = 0.5
"""Greatest time from an event to the sample at which its span begins."""
_MIN_NAMED_RISK = 0.55
"""A greatest index below this needs no reason: as a rule it is the initial estimate."""

# The page, in inches.
_LEFT, _WIDTH, _RIGHT = 1.55, 9.4, 2.15
_BOTTOM, _TOP, _TITLE = 0.55, 0.1, 0.45
_PANEL, _GAP = 0.95, 0.1
_BAND, _BAND_GAP, _LANE = 0.24, 0.04, 0.17


_Stretch = tuple[float, float]
_Span = tuple[Hashable, float, float]
"""A value, its begin and its end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Label:
    """An event's name in a lane; x in seconds, as drawn."""

    event: ReplayEvent
    lane: int
    begin_s: float
    text: str


def draw_replay(replay: Replay, file: IO[bytes]) -> None:
    """Draw a replay into a PNG file."""
    samples = replay.samples
    end_s = max(replay.duration_s, 1.0)
    clearance = any(sample.place and sample.place.clearance_m is not None for sample in samples)
    bands = {
        kind: _spans(samples, word, end_s)
        for kind, word in _BANDS.items()
        if kind == "mode" or any(map(word, samples))
    }
    panels = len(_COLOURS) + clearance
    with page_style():
        labels, unnamed = _placed(
            [event for event in replay.events if not _is_in_band(event, bands, end_s)], end_s
        )
        lanes = max((label.lane for label in labels), default=-1) + 1
        events_in = max(lanes, 1) * _LANE
        bands_in = len(bands) * (_BAND + _BAND_GAP)
        height_in = _BOTTOM + panels * (_PANEL + _GAP) + bands_in + events_in + _TITLE + _TOP
        page = Page(_LEFT + _WIDTH + _RIGHT, height_in)
        bottom_in = _BOTTOM + panels * (_PANEL + _GAP)
        for row, (kind, spans) in enumerate(bands.items()):
            band = page.panel(_LEFT, bottom_in + row * (_BAND + _BAND_GAP), _WIDTH, _BAND)
            _draw_band(band, kind, spans, end_s)
        rows = [
            page.panel(_LEFT, bottom_in - (row + 1) * (_PANEL + _GAP) + _GAP, _WIDTH, _PANEL)
            for row in range(panels)
        ]
        for axes, name in zip(rows, _COLOURS, strict=False):
            _draw_index(axes, name, samples, end_s)
        if clearance:
            _draw_clearance(rows[-1], samples, end_s)
        events = page.panel(_LEFT, bottom_in + bands_in, _WIDTH, events_in)
        _draw_labels(events, labels, lanes, end_s)
        for axes in rows:
            _mark(axes, [label.event for label in labels], end_s)
            axes.tick_params(labelbottom=axes is rows[-1])
        rows[-1].set_xlabel("time (s)")
        _draw_title(page, replay, unnamed)
        page.figure.savefig(file, format="png", dpi=DPI)


def _draw_index(axes: Any, name: str, samples: Sequence[ReplaySample], end_s: float) -> None:
    """One index; hatched where it was never known, grey where it is held without measurement."""
    values = [sample.risk[name] for sample in samples]
    _shade_armed(axes, samples, end_s)
    for held, begin_s, stop_s in _spans(samples, lambda s: _is_held(s, name), end_s):
        if held:
            axes.axvspan(begin_s, stop_s, color=_HELD, lw=0)
    _draw_curve(axes, samples, values, _COLOURS[name], end_s)
    axes.set_ylim(-0.04, 1.04)  # so that the frame hides neither 0 nor 1
    axes.set_yticks([0.0, 0.5, 1.0])
    axes.text(-0.055, 0.5, name, transform=axes.transAxes, ha="right", va="center")
    _aside(axes, _greatest(name, samples), _COLOURS[name])


def _greatest(name: str, samples: Sequence[ReplaySample]) -> str:
    """Greatest value of an index, its first time, and the deciding input."""
    known = [
        (sample.risk[name] or 0.0, sample) for sample in samples if sample.risk[name] is not None
    ]
    if not known:
        return "unknown"
    greatest = max(risk for risk, _ in known)
    reached = [sample for risk, sample in known if risk >= greatest - 0.005]
    sample = next((sample for sample in reached if sample.why[name] is not None), reached[0])
    words = f"at most {greatest:.2f}, at {sample.time_s:.0f} s"
    if greatest < _MIN_NAMED_RISK:
        return words
    return f"{words}\n{sample.why[name] or 'nothing measured'}"


def _draw_clearance(axes: Any, samples: Sequence[ReplaySample], end_s: float) -> None:
    _shade_armed(axes, samples, end_s)
    values = [None if s.place is None else s.place.clearance_m for s in samples]
    _draw_curve(axes, samples, values, _CLEARANCE, end_s)
    known = [(v, s.time_s) for v, s in zip(values, samples, strict=True) if v is not None]
    least_m, time_s = min(known)
    axes.set_ylim(min(0.0, least_m), max(value for value, _ in known) * 1.1 + 0.1)
    axes.text(-0.055, 0.5, "clearance\n(m)", transform=axes.transAxes, ha="right", va="center")
    _aside(axes, f"at least {least_m:.2f} m, at {time_s:.0f} s", _CLEARANCE)


def _draw_curve(
    axes: Any,
    samples: Sequence[ReplaySample],
    values: Sequence[float | None],
    colour: str,
    end_s: float,
) -> None:
    """A value over time; where it is None there is no curve, but hatching."""
    known = dict(zip((sample.time_s for sample in samples), values, strict=True))
    for unknown, begin_s, stop_s in _spans(samples, lambda s: known[s.time_s] is None, end_s):
        if unknown:
            axes.axvspan(begin_s, stop_s, facecolor="none", edgecolor=_UNKNOWN, hatch="////", lw=0)
    heights = np.array([np.nan if value is None else value for value in values])
    axes.plot(list(known), heights, color=colour, lw=1.5)


def _draw_band(axes: Any, name: str, spans: Sequence[_Span], end_s: float) -> None:
    """A row of spans, each with its name where there is room for it."""
    shades = itertools.cycle(_SPANS)
    for span in spans:
        text, begin_s, stop_s = span
        axes.axvspan(begin_s, stop_s, color=next(shades) if text else _UNKNOWN_SPAN, lw=0)
        if _has_room(span, end_s):
            axes.text(
                0.5 * (begin_s + stop_s),
                0.45,
                str(text),
                ha="center",
                va="center",
                fontsize=_LABEL_SIZE,
                color=INK,
                parse_math=False,
            )
    axes.set_xlim(0.0, end_s)
    axes.set_ylim(0.0, 1.0)
    axes.set_axis_off()
    axes.text(-0.055, 0.45, name, transform=axes.transAxes, ha="right", va="center")


def _draw_labels(axes: Any, labels: Sequence[_Label], lanes: int, end_s: float) -> None:
    """The events' names above, each on a line down to its time."""
    axes.set_xlim(0.0, end_s)
    axes.set_ylim(0.0, max(lanes, 1))
    axes.set_axis_off()
    for label in labels:
        colour = _KINDS[label.event.kind]
        time_s = label.event.time_s
        axes.plot([time_s, time_s], [0.0, label.lane + 0.8], color=colour, lw=0.6, clip_on=False)
        axes.text(
            label.begin_s,
            label.lane + 0.5,
            label.text,
            va="center",
            fontsize=_LABEL_SIZE,
            color=colour,
            parse_math=False,
        )


def _draw_title(page: Page, replay: Replay, unnamed: int) -> None:
    """Draw the recording's name, the legend of the shades, and the number of unnamed events."""
    vehicle = f" {replay.vehicle_type}" if replay.vehicle_type else ""
    autopilot = f"{replay.autopilot}{vehicle}" if replay.vehicle_type else "no autopilot"
    name = _shortened(replay.recording, _LONGEST_NAME)
    page.figure.text(
        _LEFT / page.width_in,
        1.0 - (_TOP + 0.2) / page.height_in,
        f"{name}: {autopilot}, {replay.duration_s:.0f} s",
        fontsize=10.5,
        weight="bold",
        va="center",
        parse_math=False,
    )
    page.figure.legend(
        handles=[
            Patch(facecolor=_ARMED, label="armed"),
            Patch(facecolor=_HELD, label="not measured now"),
            Patch(facecolor="white", edgecolor=_UNKNOWN, hatch="////", label="unknown"),
        ],
        loc="upper right",
        ncols=3,
        frameon=False,
        fontsize=8.0,
    )
    if unnamed:
        note = f"and {unnamed} more event{'s' if unnamed > 1 else ''}"
        x = (_LEFT + _WIDTH) / page.width_in
        page.figure.text(x, 0.12 / page.height_in, note, fontsize=7.5, color="#555555", ha="right")


def _aside(axes: Any, text: str, colour: str) -> None:
    """Text at the right of a panel."""
    axes.text(
        1.012,
        0.5,
        text,
        transform=axes.transAxes,
        va="center",
        fontsize=7.5,
        color=colour,
        parse_math=False,
    )


def _shade_armed(axes: Any, samples: Sequence[ReplaySample], end_s: float) -> None:
    axes.set_xlim(0.0, end_s)
    axes.grid(visible=True, color="#e2e2e2", lw=0.6)
    axes.set_axisbelow(True)
    for armed, begin_s, stop_s in _spans(samples, lambda sample: sample.armed, end_s):
        if armed:
            axes.axvspan(begin_s, stop_s, color=_ARMED, lw=0, zorder=0)


def _mark(axes: Any, events: Sequence[ReplayEvent], end_s: float) -> None:
    for event in events:
        axes.axvline(min(event.time_s, end_s), color=_KINDS[event.kind], lw=0.5, alpha=0.6)


def _is_held(sample: ReplaySample, name: str) -> bool:
    """Returns True if an index holds an earlier value, without a measurement now."""
    return sample.risk[name] is not None and sample.why[name] is None


def _spans(
    samples: Sequence[ReplaySample], of: Callable[[ReplaySample], Hashable], end_s: float
) -> list[_Span]:
    """Successive samples with the same value."""
    groups = [(value, next(group).time_s) for value, group in itertools.groupby(samples, of)]
    stops_s = [begin_s for _, begin_s in groups[1:]] + [end_s]
    return [(value, begin_s, stop) for (value, begin_s), stop in zip(groups, stops_s, strict=True)]


def _has_room(span: _Span, end_s: float) -> bool:
    """Returns True if a span of a band is long enough for its name."""
    text, begin_s, stop_s = span
    return text is not None and _width_s(str(text), end_s) < stop_s - begin_s


def _is_in_band(event: ReplayEvent, bands: Mapping[str, Sequence[_Span]], end_s: float) -> bool:
    """Returns True if a band names a mode or state; its span begins one sample late at most."""
    return any(
        event.text.startswith(str(span[0])) and span[1] - _SAMPLE_S <= event.time_s < span[2]
        for span in bands.get(event.kind, ())
        if _has_room(span, end_s)
    )


def _placed(events: Sequence[ReplayEvent], end_s: float) -> tuple[list[_Label], int]:
    """Labels of the events that fit, the important first, and the number of those that do not."""
    order = list(_KINDS)
    named = [event for event in events if event.kind in _KINDS and not _is_quiet(event)]
    chosen: list[tuple[ReplayEvent, str, float]] = []
    labels: list[_Label] = []
    for event in sorted(named, key=lambda item: (order.index(item.kind), item.time_s)):
        for longest in _LONGEST_LABELS:
            text = _shortened(event.text.removeprefix(_AUTOPILOT), longest)
            trial = [*chosen, (event, text, _width_s(text, end_s))]
            arranged = _arranged(trial, end_s)
            if arranged is not None:
                chosen, labels = trial, arranged
                break
    return labels, len(named) - len(labels)


def _arranged(
    events: Sequence[tuple[ReplayEvent, str, float]], end_s: float
) -> list[_Label] | None:
    """Events with their texts and widths in lanes; None where there are too few lanes.

    A text lies right of its event's line, which runs from it down through all lanes below. From
    right to left each finds the lowest lane in which it crosses no text and no line.
    """
    taken: list[list[_Stretch]] = [[] for _ in range(_LANES)]
    labels: list[_Label] = []
    for event, text, width_s in sorted(events, key=lambda item: -item[0].time_s):
        begin_s = event.time_s + _PAD * end_s
        span = (begin_s, begin_s + width_s)
        lane = 0
        while lane < _LANES and any(map(partial(_overlap, span), taken[lane])):
            lane += 1
        if lane == _LANES:
            return None
        taken[lane].append(span)
        for passed in taken[: lane + 1]:
            passed.append((event.time_s, begin_s))
        labels.append(_Label(event=event, lane=lane, begin_s=begin_s, text=text))
    return labels


def _overlap(one: _Stretch, other: _Stretch) -> bool:
    return one[0] < other[1] and other[0] < one[1]


def _is_quiet(event: ReplayEvent) -> bool:
    words = event.text.split(maxsplit=2)
    return event.kind == "text" and words[1:2] != [] and words[1] in _QUIET_TEXTS


def _shortened(text: str, longest: int) -> str:
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def _width_s(text: str, end_s: float) -> float:
    """The room that a text takes on the time axis, with a little space after it."""
    width_points = _text_width(text) * _LABEL_SIZE / _FONT_UNIT
    return (width_points / 72.0 + 0.08) / _WIDTH * end_s


@cache
def _text_width(text: str) -> float:
    """Width in units of `_FONT_UNIT` to the font's size."""
    path = TextPath((0.0, 0.0), text.replace("$", r"\$"), size=_FONT_UNIT, prop=_FONT)
    return float(path.get_extents().width) if len(path.vertices) else 0.0
