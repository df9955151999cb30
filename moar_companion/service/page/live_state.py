"""State that viewers see, and its changes as JSON Merge Patches (RFC 7396). No I/O.

The state is the status of the view (`status_values.Status`), and beside it `before`: the path
before the last change, `site_revision`: number of the site's last change, `silent_s`: time without
a status, null below a second.

In a merge patch null removes a value. A value that is null is therefore unknown or absent, which
for a display is the same.
"""

from __future__ import annotations

import json
import math
from collections import deque
from typing import Any

State = dict[str, Any]

_SLOW = ("risk", "weights", "age_s", "batteries", "energy", "link", "host")
"""Sections that change in each status, by their ages; four fifths of its bytes."""
_SLOW_PERIOD_S = 0.5
"""Period of those: as often as a recording has them."""
_SILENT_S = 1.0
_FLOWN_STEP_M = 0.1
_MOST_FLOWN = 5000
"""Points of the flown path; the oldest ones are dropped."""
_DECIMALS = 7
"""Of a latitude in degrees: 1 cm."""


def json_text(value: Any) -> str:
    """A value as compact JSON."""
    return json.dumps(value, allow_nan=False, separators=(",", ":"), ensure_ascii=False)


def merge_patch(before: State, after: State) -> State:
    """The merge patch from one state to another; empty where they are the same to a viewer."""
    patch: State = {}
    for name in before.keys() - after.keys():
        if before[name] is not None:
            patch[name] = None
    for name, value in after.items():
        old = before.get(name)
        if old == value:
            continue
        if isinstance(old, dict) and isinstance(value, dict):
            patch[name] = merge_patch(old, value)
        else:
            patch[name] = value
    return patch


class LiveState:
    """State of one aircraft, with the flown path, from statuses in order of time.

    slow_period_s: of the sections whose ages change in each status.
    """

    def __init__(self, *, slow_period_s: float = _SLOW_PERIOD_S) -> None:
        self._slow_period_s = slow_period_s
        self.state: State = {}
        self.flown: deque[list[float]] = deque(maxlen=_MOST_FLOWN)
        """Places of the aircraft: x, y, z in metres, at least 0.1 m apart."""
        self.changes: State = {}
        """Patch of the last update."""
        self._received_s = -math.inf
        self._slow_due_s = -math.inf
        self._paths: int | None = None

    def update(self, status: State, now_s: float, *, site_revision: int | None = None) -> bool:
        """Takes a status; True if anything has changed. now_s: a clock that never steps."""
        shown = _rounded(status)
        shown["before"] = self._path_before(shown)
        shown["site_revision"] = site_revision
        if now_s < self._slow_due_s:
            shown |= {name: self.state[name] for name in _SLOW if name in self.state}
        else:
            self._slow_due_s = now_s + self._slow_period_s
        self._received_s = now_s
        self._note_place(shown)
        return self._become(shown)

    def note_silence(self, now_s: float) -> bool:
        """Notes the time without a status; True if that changes the state."""
        silent_s = now_s - self._received_s
        if not self.state or silent_s < _SILENT_S:
            return False
        return self._become(self.state | {"silent_s": float(round(silent_s))})

    def whole(self) -> str:
        """Frame of a new viewer, and of one that has missed changes."""
        return json_text({"all": self.state, "flown": list(self.flown)})

    def patch(self) -> str:
        """Frame of a viewer that has the state before the last change."""
        return json_text({"changed": self.changes})

    def _become(self, state: State) -> bool:
        self.changes = merge_patch(self.state, state)
        self.state = state
        return bool(self.changes)

    def _path_before(self, status: State) -> State | None:
        """The path before the present one, to the same place; None until it has changed."""
        plan, last = status.get("plan"), self.state.get("plan")
        if plan is None:
            return None
        if last is None or any(plan[name] != last[name] for name in ("mission", "target")):
            return None
        if plan["paths"] == last["paths"]:
            before: State | None = self.state.get("before")
            return before
        return {"path": last["path"]}

    def _note_place(self, status: State) -> None:
        place = (status.get("aircraft") or {}).get("position_m")
        if place is None:
            return
        if not self.flown or math.dist(self.flown[-1], place) >= _FLOWN_STEP_M:
            self.flown.append(list(place))


def _rounded(value: Any) -> Any:
    """A value with numbers as displays need them: shorter, and seldom different."""
    if isinstance(value, float):
        return round(value, _DECIMALS)
    if isinstance(value, dict):
        return {
            name: round(item, 1)
            if isinstance(item, float) and name.endswith("age_s")
            else _rounded(item)
            for name, item in value.items()
        }
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return value
