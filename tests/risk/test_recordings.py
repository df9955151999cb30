"""Recorded trouble raises the right index within 3 s, and no other one without a cause.

The first packet that shows the trouble is found by pymavlink alone.
"""

from __future__ import annotations

import math
from functools import cache

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.commands.replay import played
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from tests.mavlink.conftest import SHARED, packets

TRACES = SHARED / "traces"
pytestmark = [
    pytest.mark.slow,
    pytest.mark.recordings,
    pytest.mark.skipif(not TRACES.exists(), reason="no recordings beside the checkout"),
]
WITHIN_S = 3.0
SETTLED_S = 15.0
"""Until then indices come down from the unknown."""
RISE = 0.1


def tilt_deg(message):
    return math.degrees(math.acos(math.cos(message.roll) * math.cos(message.pitch)))


# Recording, first message of the trouble, earliest time, index, greatest value.
TROUBLE = {
    "the wind rises (ArduPilot)": (
        *("ardupilot/c1_wind", "ATTITUDE", lambda m: tilt_deg(m) > 8.0, SETTLED_S),
        *("wind", 0.5),
    ),
    "the wind rises, with drag fusion (ArduPilot)": (
        *("ardupilot/c2_wind_drag", "ATTITUDE", lambda m: tilt_deg(m) > 8.0, SETTLED_S),
        *("wind", 0.5),
    ),
    "a true wind of 6 m/s begins (ArduPilot)": (
        *("ardupilot/c3_wind_const", "ATTITUDE", lambda m: tilt_deg(m) > 4.0, 5.0),
        *("wind", 0.5),
    ),
    "the wind rises once more (PX4)": (
        *("px4/c1_wind_v118", "ATTITUDE", lambda m: tilt_deg(m) > 14.0, 30.0),
        *("wind", 0.7),
    ),
    "satellites are lost (ArduPilot)": (
        *("ardupilot/d1_gps_sats", "GPS_RAW_INT", lambda m: m.satellites_visible <= 6, 3.0),
        *("localization", 0.7),
    ),
    "dilution grows (ArduPilot)": (
        *("ardupilot/d5_hdop_flight", "GPS_RAW_INT", lambda m: m.eph >= 200, 5.0),
        *("localization", 0.6),
    ),
    "satellites are lost (PX4)": (
        *("px4/d1_gps_degradation", "GPS_RAW_INT", lambda m: m.satellites_visible <= 6, SETTLED_S),
        *("localization", 0.7),
    ),
    "the receiver falls silent (PX4)": (
        *("px4/d3_gps_silent_v117", "GPS_RAW_INT", lambda m: m.fix_type < 3, SETTLED_S),
        *("localization", 0.7),
    ),
    "the battery is low (ArduPilot)": (
        *("ardupilot/b_batt", "BATTERY_STATUS", lambda m: m.charge_state >= 2, SETTLED_S),
        *("battery", 0.7),
    ),
    # 10 % is used 8 s after arming: the rest lasts 72 s, not the 18 min of the vehicle file.
    "the battery drains (PX4)": (
        *("px4/b1_battery_drain", "BATTERY_STATUS", lambda m: m.battery_remaining <= 90, SETTLED_S),
        *("battery", 0.7),
    ),
}

# Reasons why another settled index rises by more than 0.1.
CAUSES = {
    ("ardupilot/b_batt", "wind"): "it has landed, where nothing is measured of the wind",
    (
        "ardupilot/d1_gps_sats",
        "wind",
    ): "after the glitch its estimator has no position: the wind is unknown",
    ("ardupilot/d5_hdop_flight", "wind"): "the same, until the fix comes back",
    ("px4/d1_gps_degradation", "battery"): "the simulated battery falls from 100 to 50 %",
    ("px4/d1_gps_degradation", "wind"): "without a position the lean tells nothing of the wind",
    ("px4/d3_gps_silent_v117", "battery"): "the simulated battery falls from 100 to 50 %",
}

VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml")


def path_of(name):
    return TRACES / f"{name}.companion.tlog"


@cache
def replay_of(name):
    return played(str(path_of(name)), VEHICLE)


def first_seen_s(name, kind, shows, after_s):
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    begin_s = None
    for time_s, packet in packets(path_of(name)):
        begin_s = time_s if begin_s is None else begin_s
        for message in parser.parse_buffer(packet) or []:
            if (
                message.get_type() == kind
                and message.get_srcComponent() == 1
                and time_s - begin_s >= after_s
                and shows(message)
            ):
                return time_s - begin_s
    raise AssertionError(f"{name} never shows it")


@pytest.mark.parametrize("what", TROUBLE)
def test_recorded_trouble_raises_its_index_within_three_seconds(what):
    name, kind, shows, after_s, index, least = TROUBLE[what]
    seen_s = first_seen_s(name, kind, shows, after_s)
    samples = [sample for sample in replay_of(name).samples if sample.time_s >= after_s - 1.0]
    before = max(sample.risk[index] for sample in samples if sample.time_s <= seen_s)
    within = max(sample.risk[index] for sample in samples if sample.time_s <= seen_s + WITHIN_S)
    assert before < least <= within


@pytest.mark.parametrize("name", ["a1_boot", "g1_routing"])
def test_the_end_of_a_parameter_list_is_no_communication_risk(name):
    replay = played(str(TRACES / "ardupilot" / f"{name}.gcs.tlog"), VEHICLE)
    settled = [sample for sample in replay.samples if sample.time_s >= SETTLED_S]
    assert max(sample.risk["communication"] for sample in settled) < RISE


NAMES = sorted(
    f"{path.parent.name}/{path.name.removesuffix('.companion.tlog')}"
    for path in TRACES.glob("*/[bcd]*.companion.tlog")
)


@pytest.mark.parametrize("name", NAMES)
def test_no_other_index_rises_without_a_stated_cause(name):
    meant = {"b": "battery", "c": "wind", "d": "localization"}[name.split("/")[1][0]]
    settled = [sample for sample in replay_of(name).samples if sample.time_s >= SETTLED_S]
    rising = set()
    for index in replay_of(name).samples[0].risk:
        values = [sample.risk[index] for sample in settled if sample.risk[index] is not None]
        least = 1.0
        for value in values:
            least = min(least, value)
            if value - least > RISE and index != meant:
                rising.add(index)
    assert rising == {index for recording, index in CAUSES if recording == name}
