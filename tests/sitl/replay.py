"""Recordings of real autopilots, and the fake autopilot in the same situation.

The packets of the recorded peers are sent to the fake at the same times of the autopilot's clock.
The packets that the fake sends back are then compared one by one.
"""

import struct
from bisect import bisect_right
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.autopilot import FakeAutopilot, Options

from .conftest import Peer

RECORDINGS = Path(__file__).parents[3] / "shared" / "traces"
recorded = [
    pytest.mark.recordings,
    pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings beside the checkout"),
]
"""Marks of a module whose tests need them."""
AUTOPILOT = (1, 1)
PEERS = {"companion": (1, 195), "gcs": (255, 190)}
NAMES = {8: "LINK_NODE_STATUS", 380: "TIME_ESTIMATE_TO_TARGET", 410: "EVENT",
         411: "CURRENT_EVENT_SEQUENCE"}  # fmt: skip
"""Messages without a name in pymavlink's dialect."""
_TICK_S = 0.01


def packets(path):
    """Yield (seconds since the epoch, (system, component), packet)."""
    data = path.read_bytes()
    at = 0
    while at + 8 < len(data):
        time_s = struct.unpack(">Q", data[at : at + 8])[0] / 1e6
        at += 8
        size = data[at + 1] + 12 + (13 if data[at + 2] & 1 else 0)
        raw = data[at : at + size]
        at += size
        yield time_s, (raw[5], raw[6]), raw


def own(path):
    """Yield (seconds since the epoch, message, packet) of the autopilot's own packets."""
    mav = mavlink.MAVLink(None)
    for time_s, sender, raw in packets(path):
        if sender == AUTOPILOT:
            yield time_s, mav.decode(bytearray(raw)), raw


def in_one_process(cases, *marks):
    """Parameters that begin with a title of which much is made, so that it is made once."""
    rows = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*row, marks=(pytest.mark.xdist_group(row[0]), *marks)) for row in rows]


def name(message):
    kind = message.get_type()
    return NAMES[int(kind[8:])] if kind.startswith("UNKNOWN_") else kind


def world(**conditions):
    """Return the action that sets conditions."""

    def act(vehicle, _):
        for condition, value in conditions.items():
            setattr(vehicle.conditions, condition, value)

    return act


def parameter(name, value):
    """Return the action that sets a parameter."""
    return lambda vehicle, _: vehicle.set_parameter(name, value)


@dataclass(frozen=True, kw_only=True)
class Situation:
    """Recordings of one run of an autopilot, and how the fake comes into it.

    If the ground station's link was not recorded, its packets are those forwarded to the companion.

    actions   (seconds on the autopilot's clock, a function of the vehicle and the peers), beside
              the packets of the recorded peers; actions may begin earlier
    shift_s   run time of the fake when the recorded clock begins
    until_s   end of the comparison, on the autopilot's clock
    slack_s   by name: allowance for courses that were faster or slower than usual here
    """

    recordings: tuple
    links: tuple = ("companion", "gcs")
    options: dict = field(default_factory=dict)
    actions: tuple = ()
    shift_s: float = 0.0
    until_s: float = float("inf")
    slack_s: dict = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Recorded and sent packets of the fake, by link: (seconds, message, packet)."""

    situation: Situation
    real: dict
    fake: dict

    def slack_s(self, course, usual_s):
        """Greatest time between the two in a course."""
        return self.situation.slack_s.get(course, usual_s)


class Clock:
    """The autopilot's time at a time of the recording; it goes on across a restart."""

    def __init__(self, rows, boot_s):
        last_s, stamps = 0.0, []
        for t, message, _ in rows:
            stamp_ms = getattr(message, "time_boot_ms", None)
            if message.get_type() in ("ATTITUDE", "SYSTEM_TIME") and stamp_ms:
                if stamp_ms / 1000.0 < last_s - 1.0:
                    boot_s = stamps[-1][1] + t - stamps[-1][0] - stamp_ms / 1000.0
                last_s = stamp_ms / 1000.0
                stamps.append((t, boot_s + last_s))
        self._stamps = stamps

    def __call__(self, time_s):
        at = max(0, bisect_right(self._stamps, (time_s, float("inf"))) - 1)
        received_s, clock_s = self._stamps[at]
        return clock_s + time_s - received_s


def replay(folder, situation):
    """Return what was recorded and what the fake sends in the same situation."""
    paths = {
        link: [folder / f"{recording}.{link}.tlog" for recording in situation.recordings]
        for link in situation.links
    }
    rows = {link: [row for path in paths[link] for row in own(path)] for link in paths}
    clock = Clock(rows["companion"], situation.shift_s)
    real = {
        link: [(clock(t), m, raw) for t, m, raw in rows[link] if clock(t) <= situation.until_s]
        for link in rows
    }
    inputs = [
        (clock(t), link, raw)
        for link, sender_wanted in PEERS.items()
        for path in paths.get(link, paths["companion"])
        for t, sender, raw in packets(path)
        if sender == sender_wanted and _id(raw) != mavlink.MAVLINK_MSG_ID_PARAM_SET
    ]
    since_s = min(side[0][0] for side in real.values())
    until_s = max(side[-1][0] for side in real.values())
    fake = _fly(situation, sorted(inputs), until_s)
    return Comparison(
        situation=situation,
        real=real,
        fake={link: [row for row in fake[link] if row[0] >= since_s] for link in paths},
    )


def _id(raw):
    return int.from_bytes(raw[7:10], "little")


def _fly(situation, inputs, until_s):
    vehicle = FakeAutopilot(Options(**situation.options))
    peers = {link: Peer(vehicle, link, *PEERS[link]) for link in PEERS}
    actions = sorted(situation.actions, key=lambda action: action[0])
    first_s = inputs[0][0]
    for tick in range(round(until_s / _TICK_S)):
        now_s = tick * _TICK_S
        if now_s < first_s and tick % 100 == 0:
            peers["companion"].heartbeat()
            peers["gcs"].heartbeat(mavlink.MAV_TYPE_GCS)
        while actions and actions[0][0] <= now_s:
            actions.pop(0)[1](vehicle, peers)
        while inputs and inputs[0][0] <= now_s:
            _, link, raw = inputs.pop(0)
            vehicle.receive(link, raw)
        vehicle.step(now_s + _TICK_S)
        for link, data in vehicle.data_to_send():
            peers[link].take(data, now_s + _TICK_S)
    return {
        link: [
            (t, m, bytes(m.get_msgbuf()))
            for t, m in peer.received
            if bytes(m.get_msgbuf())[5:7] == bytes(AUTOPILOT)
        ]
        for link, peer in peers.items()
    }


# Comparing


def rows_of(rows, kind):
    """The rows of one kind of message."""
    return [row for row in rows if name(row[1]) == kind]


def counts(rows):
    found = defaultdict(int)
    for _, message, _ in rows:
        found[name(message)] += 1
    return found


def changes(values, shortest_s=0.0):
    """Return [(seconds, value)] at each change of a value, the first included.

    Values that lasted shorter than `shortest_s` are left out.
    """
    found = []
    for t, value in values:
        if found and found[-1][1] == value:
            continue
        if found and t - found[-1][0] < shortest_s:
            found.pop()
        if not found or found[-1][1] != value:
            found.append((t, value))
    return found


def fields(rows):
    """Return {(message, field): its values}; NaN as text, -0.0 as 0.0."""
    seen = defaultdict(set)
    for _, message, _ in rows:
        kind = message.get_type()
        if kind.startswith("UNKNOWN_"):
            continue
        for key in message.fieldnames:
            value = getattr(message, key)
            seen[kind, key].add(tuple(value) if isinstance(value, list) else value)
    return {
        field: {str(value + 0.0 if value == 0.0 else value) for value in values}
        for field, values in seen.items()
    }


def sizes(rows):
    """Return {message: lengths of its packets}."""
    seen = defaultdict(set)
    for _, message, raw in rows:
        seen[name(message)].add(len(raw))
    return seen


def check_counts(both, link, *, but, rel, may_stop=frozenset()):
    """Assert the same messages at the same rates, except those that may stop at another time.

    Heartbeats are counted one by one: an extra heartbeat reports a change of mode.
    """
    real, fake = counts(both.real[link]), counts(both.fake[link])
    kinds = set(real) - but
    assert kinds == set(fake) - but, link
    assert fake["HEARTBEAT"] == pytest.approx(real["HEARTBEAT"], abs=1), link
    for kind in kinds - may_stop:
        assert fake[kind] == pytest.approx(real[kind], rel=rel, abs=3), (link, kind)


def check_constants(both, link, *, but, of_another_model):
    """Values that never changed in the recording, which the fake must have."""
    fake = fields(both.fake[link])
    for (kind, key), values in fields(both.real[link]).items():
        skipped = kind in but or key in of_another_model.get(kind, ())
        if len(values) == 1 and not skipped and (kind, key) in fake:
            assert fake[kind, key] == values, (link, kind, key)


def check_course(both, kind, value, *, shortest_s, slack_s):
    """A value went through the same, at about the same times."""
    real, fake = (
        changes([(t, value(m)) for t, m, _ in rows_of(side["companion"], kind)], shortest_s)
        for side in (both.real, both.fake)
    )
    assert_same(real, fake, slack_s)


def assert_same(real, fake, slack_s):
    """These are the same changes, at about the same times."""
    assert [state for _, state in fake] == [state for _, state in real]
    for (fake_s, state), (real_s, _) in zip(fake, real, strict=True):
        assert fake_s == pytest.approx(real_s, abs=slack_s), state


def check_sensors(both, field_name, *, but, slack_s):
    """Each bit of one of SYS_STATUS's fields went through the same, but those of a mask."""
    masks = [
        [
            (t, getattr(message, f"onboard_control_sensors_{field_name}"))
            for t, message, _ in rows_of(side["companion"], "SYS_STATUS")
        ]
        for side in (both.real, both.fake)
    ]
    for bit in (1 << n for n in range(32) if not 1 << n & but):
        courses = ([(t, (hex(bit), mask & bit)) for t, mask in side] for side in masks)
        assert_same(*(changes(course, shortest_s=0.3) for course in courses), slack_s)
