"""Recorded autopilots in trouble: the right index rises within 3 s, and no other one."""

from __future__ import annotations

import gzip
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.passive_listener import PassiveListener
from moar_companion.mavlink.tlog import Tlog
from moar_companion.risk import RiskEstimate, update
from moar_companion.settings.risk_model import RiskModel

SHARED = Path(__file__).resolve().parents[3] / "shared"
STEP_S = 0.1
WITHIN_S = 3.0
RC_RECEIVER = 0x10000

pytestmark = pytest.mark.recordings


@dataclass(frozen=True, kw_only=True)
class Trouble:
    """Recorded trouble: recording, start, message that shows the trouble, expected index."""

    recording: str
    after_s: float
    message: str
    shows: Callable[[Any], bool]
    index: str
    input: str
    least: float = 0.9


def margin(radio: Any) -> int:
    return min(radio.rssi - radio.noise, radio.remrssi - radio.remnoise)


def repeated() -> Callable[[Any], bool]:
    """True if a receiver's clock has the same time as in the message before."""
    received: list[int] = []

    def shows(message: Any) -> bool:
        received.append(message.time_usec)
        return received[-1:] == received[-2:-1]

    return shows


LONG = "a pilot's transmitter is lost, in a flight of 2015"
TROUBLES = {
    "PX4 is left with few satellites": Trouble(
        recording="traces/px4/d1_gps_degradation.companion.tlog",
        after_s=15.0,
        message="GPS_RAW_INT",
        shows=lambda gps: gps.satellites_visible <= 6,
        index="localization",
        input="satellites",
        least=0.7,
    ),
    "PX4's receiver falls silent": Trouble(
        recording="traces/px4/d3_gps_silent_v117.companion.tlog",
        after_s=20.0,
        message="GPS_RAW_INT",
        shows=lambda gps: gps.fix_type == 0,
        index="localization",
        input="fix type",
    ),
    "ArduPilot is left with few satellites": Trouble(
        recording="traces/ardupilot/d1_gps_sats.companion.tlog",
        after_s=5.0,
        message="GPS_RAW_INT",
        shows=lambda gps: gps.satellites_visible <= 5,
        index="localization",
        input="satellites",
    ),
    "ArduPilot's receiver is jammed": Trouble(
        recording="traces/ardupilot/d1_gps_sats.companion.tlog",
        after_s=38.0,
        message="GPS_RAW_INT",
        shows=lambda gps: gps.h_acc >= 5000,
        index="localization",
        input="receiver accuracy",
    ),
    "ArduPilot's receiver loses its geometry": Trouble(
        recording="traces/ardupilot/d5_hdop_flight.companion.tlog",
        after_s=15.0,
        message="GPS_RAW_INT",
        shows=lambda gps: 300 <= gps.eph < 9999,
        index="localization",
        input="hdop",
    ),
    "ArduPilot repeats a dead receiver": Trouble(
        recording="traces/ardupilot/d5_hdop_flight.companion.tlog",
        after_s=55.0,
        message="GPS_RAW_INT",
        shows=repeated(),
        index="localization",
        input="receiver clock stopped",
    ),
    "a radio at the edge of its reach, beside PX4": Trouble(
        recording="traces/px4/f1_radio_rc.companion.tlog",
        after_s=15.0,
        message="RADIO_STATUS",
        shows=lambda radio: margin(radio) <= 10,
        index="communication",
        input="radio margin there",
    ),
    "ArduPilot loses the pilot's transmitter": Trouble(
        recording="traces/ardupilot/j1_failsafe.companion.tlog",
        after_s=30.0,
        message="SYS_STATUS",
        shows=lambda status: not status.onboard_control_sensors_health & RC_RECEIVER,
        index="communication",
        input="remote control lost",
    ),
    LONG: Trouble(
        recording="data/mavlink_tlog/dronekit_flight_replay.tlog",
        after_s=300.0,
        message="SYS_STATUS",
        shows=lambda status: not status.onboard_control_sensors_health & RC_RECEIVER,
        index="communication",
        input="remote control lost",
    ),
    "the pilot's signal goes to nothing": Trouble(
        recording="traces/ardupilot/f1_rssi.companion.tlog",
        after_s=20.0,
        message="RC_CHANNELS",
        shows=lambda channels: channels.rssi == 0,
        index="communication",
        input="remote control",
    ),
}


def records(path: Path) -> Tlog:
    """Packets of a recording, which may be compressed."""
    data = path.read_bytes()
    return Tlog(gzip.decompress(data) if path.suffix == ".gz" else data)


def judged(trouble: Trouble) -> tuple[RiskEstimate, list[RiskEstimate]]:
    """Estimate before the first packet that shows the trouble, and those of the next 3 s."""
    path = SHARED / trouble.recording
    if not path.exists():
        pytest.skip(f"the recording {path} is not here")
    reader, witness = Codec(system_id=9, component_id=9), PassiveListener()
    risk = before = RiskEstimate.unknown(RiskModel())
    after: list[RiskEstimate] = []
    begin_s = shown_s = None
    ticks = 0
    for record in records(path):
        begin_s = record.time_s if begin_s is None else begin_s
        now_s = record.time_s - begin_s
        while ticks * STEP_S < now_s:
            tick_s = ticks * STEP_S
            witness.tick(tick_s)
            risk = update(risk, witness.telemetry, tick_s, model=RiskModel(), cruise_mps=5.0)
            ticks += 1
            if shown_s is not None:
                after.append(risk)
        if shown_s is None and now_s > trouble.after_s:
            messages = reader.receive(record.packet)
            if any(m.get_type() == trouble.message and trouble.shows(m) for m in messages):
                shown_s, before = now_s, risk
        elif shown_s is not None and now_s > shown_s + WITHIN_S:
            break
        witness.handle(record.packet, now_s)
    return before, after


@pytest.mark.parametrize(
    "title",
    [pytest.param(title, marks=pytest.mark.slow if title == LONG else ()) for title in TROUBLES],
)
def test_recorded_trouble_raises_the_right_index_within_3_s_and_no_other(title):
    trouble = TROUBLES[title]
    before, after = judged(trouble)
    assert after, "the recording does not show it"
    last = after[-1]
    assert getattr(last.indices, trouble.index) >= trouble.least
    inputs = getattr(last.report, trouble.index).inputs
    assert next(found.risk for found in inputs if found.name == trouble.input) >= 0.5
    for name, value in before.indices.as_dict().items():
        if name != trouble.index:
            rise = max(getattr(risk.indices, name) for risk in after) - value
            assert rise <= 0.1, name
