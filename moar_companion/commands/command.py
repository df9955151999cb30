"""`moar-companion command`: the operator's side, on MAVSDK: an order to the companion, its answer.

An order is repeated until its answer arrives, with a rising confirmation, by which the companion
recognises a repeat. MAVSDK's own repeats have none: a late repeat looks like a new order.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import re
import time
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

from ..companion.mission_states import STREAMING, MissionState
from ..errors import LinkError
from ..mavlink.commands import ORDERS, RESULT_NAMES, CommandResult
from ..mavlink.modes import mode_name
from ..mavlink.translate import autopilot_kind
from ..mavlink.urls import parse_url
from ..types import Mission
from .ground_station import COMPANION, GroundStation
from .options import add_file, add_json, number, refused
from .outputs import json_output, print_text

_STATUS = "status"
_WORDS = (*ORDERS, _STATUS)
_ANY = -1
"""All targets; any landing point."""
_ALL = "all"
"""Target of an order of all targets, as without one."""

_AUTOPILOT = 1
"""The autopilot's component id."""
_RISKS = {
    "wind": "RISK_WIND",
    "communication": "RISK_COMM",
    "localization": "RISK_LOC",
    "battery": "RISK_BATT",
}
_WEIGHTS = {"safety": "K_SAFETY", "time": "K_TIME", "energy": "K_ENERGY"}
_ARMED = 128

_REPEAT_S = 0.5
_REASON_S = 1.0
"""The text with the reason follows the acknowledgement at once."""
_LISTEN_S = 2.5
"""Long enough for two heartbeats, and for all risks and weights several times."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the order, its target, the link, the site and the time-out."""
    parser.add_argument(
        "order",
        metavar="|".join(_WORDS),
        type=_word,
        help=f"the order; {_STATUS} orders nothing and shows what the companion says of itself",
    )
    parser.add_argument(
        "--target",
        metavar="NAME|INDEX",
        help="inspection: the target, or all (the default); exit and evacuation: index of the "
        "landing point (default: any); indices begin at 0, a name needs --site",
    )
    parser.add_argument(
        "--connect",
        metavar="URL",
        required=True,
        help="a link on which the companion is received, through the autopilot or its own: "
        "udp:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD",
    )
    add_file(parser, "--site", "the companion's site, which knows the targets' names")
    parser.add_argument(
        "--timeout",
        metavar="S",
        type=_timeout,
        default=5.0,
        help="how long the companion may be silent, in s (default: 5)",
    )
    add_json(parser, f"{_STATUS}: write it as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Sends the order and prints the answer; 0 when it is accepted."""
    address = parse_url(arguments.connect)
    order: str = arguments.order
    index = _index(order, arguments.target, arguments.site)
    if arguments.json is not None and order != _STATUS:
        raise refused("--json", arguments.json, f"but {order} has none: it is of {_STATUS}")
    with (
        json_output(arguments.json) as document,
        contextlib.closing(GroundStation(address)) as operator,
    ):
        operator.find_companion(arguments.timeout)
        if order == _STATUS:
            print_text(f"{_status(operator, document)}\n")
            return 0
        return _give(operator, order, index, arguments.timeout)


def _word(text: str) -> str:
    if text not in _WORDS:
        raise refused("MISSION", text, f"must be one of {', '.join(_WORDS)}")
    return text


def _timeout(text: str) -> float:
    value = number(text)
    if value is None or value <= 0.0:
        raise refused("--timeout", text, "must be a number of seconds above 0")
    return value


def _index(order: str, given: str | None, site_file: str | None) -> int:
    """param2 of the order. A target's name takes precedence over an index of the same form."""
    if given is None:
        return _ANY
    if order not in {mission.value for mission in Mission}:
        raise refused("--target", given, f"but {order} has no target")
    names: list[str] | None = None
    if site_file is not None:
        from ..planner.site import Site  # noqa: PLC0415

        site, mission = Site.load(site_file), Mission(order)
        names = [*site.target_names]
        if not mission.visits_targets:
            names = [str(index) for index in range(len(site.landing_m.get(mission, ())))]
        if given in names:
            return names.index(given)
    what = "target" if Mission(order).visits_targets else "landing point"
    if names == []:
        raise refused("--target", given, f"but the site has no {what}")
    if given == _ALL and what == "target":
        return _ANY
    if re.fullmatch(r"\d{1,5}", given, re.ASCII) and (names is None or int(given) < len(names)):
        return int(given)
    by_name = " or, with --site, its name" if what == "target" else ""
    known = f"one of {', '.join(names)}" if names else f"the index of a {what}{by_name}"
    raise refused("--target", given, f"must be {known}")


# The order and its answer


def _give(operator: GroundStation, order: str, index: int, timeout_s: float) -> int:
    """Sends the order, prints the answer and, if refused, the reason; returns the exit status."""
    result, texts = _answer(operator, order, index, timeout_s)
    name = RESULT_NAMES.get(result, f"REFUSED, result {result}")
    print_text(f"{order}: {name}\n")
    if result == CommandResult.ACCEPTED:
        return 0
    verdict = f", {name.lower().rpartition('_')[2]}"
    if any(text.endswith(verdict) for text in texts):
        return 1  # printed already: the first of several equal answers was lost
    for message in operator.listen(_REASON_S):
        if message.text is not None:
            print_text(f"{message.text}\n")
            if message.text.endswith(verdict):
                break
    else:
        print_text("(no reason was received)\n")
    return 1


def _answer(
    operator: GroundStation, order: str, index: int, timeout_s: float
) -> tuple[int, list[str]]:
    """The final MAV_RESULT and the texts until then, which it prints; repeats the order meanwhile.

    Raises LinkError without any answer, not even IN_PROGRESS, for the time-out.
    """
    command, param1 = ORDERS[order]
    confirmation, in_progress = 0, False
    texts: list[str] = []
    until_s = time.monotonic() + timeout_s
    while time.monotonic() < until_s:
        operator.send_command(command, param1, index, confirmation=confirmation)
        confirmation = min(confirmation + 1, 255)
        for message in operator.listen(_REPEAT_S):
            if message.text is not None:
                texts.append(message.text)
                print_text(f"{message.text}\n")
            if not operator.is_answer(message, command):
                continue
            result: int = message.fields["result"]
            if result != CommandResult.IN_PROGRESS:
                return result, texts
            until_s = time.monotonic() + timeout_s
            if not in_progress:
                print_text(f"{order}: {RESULT_NAMES[result]}\n")
            in_progress = True
    raise LinkError(f"{order}: the companion has not answered for {timeout_s:g} s")


# The companion's status


def _status(operator: GroundStation, document: dict[str, Any]) -> str:
    """Messages received within a few seconds, as text for the operator; fills the document."""
    beats: dict[int, Mapping[str, Any]] = {}
    values: dict[str, float | None] = {}
    texts: dict[str, None] = {}
    for message in operator.listen(_LISTEN_S):
        if message.name == "HEARTBEAT":
            beats[message.component] = message.fields
        elif message.component == COMPANION and message.name == "NAMED_VALUE_FLOAT":
            values[message.fields["name"]] = message.fields["value"]
        elif message.text is not None:
            texts[message.text] = None
    companion, autopilot = beats.get(COMPANION), beats.get(_AUTOPILOT)
    document |= {
        "system_id": operator.system_id,
        "companion": None if companion is None else _companion(companion),
        "autopilot": None if autopilot is None else _autopilot(autopilot),
        "risk": {word: _finite(values.get(name)) for word, name in _RISKS.items()},
        "weights": {word: _finite(values.get(name)) for word, name in _WEIGHTS.items()},
        "texts": list(texts),
    }
    known = f"system {operator.system_id}, component {COMPANION}"
    lines = (
        ("companion", known if companion is None else f"{known}: {_companion(companion)}"),
        ("autopilot", "not received" if autopilot is None else _autopilot(autopilot)),
        ("risks", _values(_RISKS, values)),
        ("weights", _values(_WEIGHTS, values)),
        *(("texts", text) for text in texts or ["none received"]),
    )
    return "\n".join(f"{what:10} {words}" for what, words in lines)


def _companion(heartbeat: Mapping[str, Any]) -> str:
    states = tuple(MissionState)
    number = heartbeat["custom_mode"]
    if number >= len(states):
        return f"state {number}"
    state = states[number]
    return f"{state.value}, streams {'setpoints' if state in STREAMING else 'nothing'}"


def _autopilot(heartbeat: Mapping[str, Any]) -> str:
    kind = autopilot_kind(SimpleNamespace(**heartbeat))
    if kind is None:
        return "no aircraft"
    armed = "armed" if heartbeat["base_mode"] & _ARMED else "disarmed"
    return f"{kind}, {armed}, {mode_name(kind, heartbeat['custom_mode'], heartbeat['type'])}"


def _values(names: Mapping[str, str], values: Mapping[str, float | None]) -> str:
    return ", ".join(
        f"{word} {_value(values[name]) if name in values else 'not received'}"
        for word, name in names.items()
    )


def _value(value: float | None) -> str:
    """A value from the companion, for people."""
    known = _finite(value)
    return "unknown" if known is None else f"{known:.2f}"


def _finite(value: float | None) -> float | None:
    """A value from the companion; MAVSDK reports one that is not finite as null."""
    return value if value is not None and math.isfinite(value) else None
