"""A recording played back: its values, its events and its time."""

from __future__ import annotations

import gzip
import io
import json
import math
import random
import struct
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from moar_companion.analysis.pictures.replay_picture import draw_replay
from moar_companion.analysis.replay import player
from moar_companion.analysis.replay.player import SAMPLE_PERIOD_S, Player
from moar_companion.analysis.replay.site_position import SitePosition
from moar_companion.mavlink import telemetry_receiver
from moar_companion.mavlink.codec import checksum
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.passive_listener import PassiveListener
from moar_companion.mavlink.tlog import Tlog
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.risk import update
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import Mission
from tests.mavlink.conftest import SHARED
from tests.mavlink.messages import message_of
from tests.mavlink.peer import Peer
from tests.thorough import sampled

from .recordings import RECORDED

VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml")
DATA = Path(__file__).parents[1] / "data"
T0_S = 1_700_000_000.0
OFFBOARD = 0x00060000
ARMED = 128 + 29


class Tape:
    """A recording in the making: one heartbeat a second of autopilot and ground station."""

    def __init__(self, playback=None):
        self.playback = playback or Player(VEHICLE, PassiveListener())
        self.autopilot = Peer(1, 1)
        self.companion = Peer(1, 195)
        self.ground = Peer(255, 190)
        self.now_s = T0_S
        self.heartbeat = {}

    def record(self, *packets):
        for packet in packets:
            self.playback.feed(self.now_s, packet)

    def send(self, name, **fields):
        self.record(self.autopilot.pack(message_of(name, **fields)))

    def run(self, seconds, **streams):
        """Heartbeats and these messages of the autopilot, once a second."""
        for _ in range(round(seconds)):
            self.now_s += 1.0
            self.record(self.autopilot.heartbeat(**self.heartbeat), self.ground.ground_heartbeat())
            for name, fields in streams.items():
                self.send(name, **fields)

    def say(self, words, severity=6):
        self.record(self.companion.pack(message_of("STATUSTEXT", severity=severity, text=words)))

    def end(self):
        return self.playback.finish("tape")


def events(replay, *kinds):
    return [(event.kind, event.text) for event in replay.events if event.kind in kinds]


def at(replay, time_s):
    return next(sample for sample in replay.samples if sample.time_s >= time_s)


GOOD_GPS = {"GPS_RAW_INT": {"fix_type": 3, "eph": 80, "satellites_visible": 14, "time_usec": 0}}
BATTERY = {"voltages": [65535] * 10, "voltages_ext": [0] * 4, "current_battery": -1}


def battery(remaining, charge_state=0):
    return {"battery_remaining": remaining, "charge_state": charge_state, **BATTERY}


def test_samples_come_at_a_regular_rate_from_the_first_packet_to_the_last():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(10)
    replay = tape.end()
    times_s = [sample.time_s for sample in replay.samples]
    assert times_s == pytest.approx([n * SAMPLE_PERIOD_S for n in range(21)])
    assert replay.duration_s == pytest.approx(10.0)


def test_an_index_is_null_until_one_of_its_inputs_is_received():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(5)
    tape.run(5, **GOOD_GPS)
    replay = tape.end()
    assert at(replay, 4.0).risk["localization"] is None
    assert 0.0 <= at(replay, 8.0).risk["localization"] < 0.5
    assert {sample.risk["wind"] for sample in replay.samples} == {None}
    assert {sample.risk["battery"] for sample in replay.samples} == {None}
    measures = replay.measures["localization"]
    assert measures["satellites"].known_s == pytest.approx(4.0, abs=0.2)
    assert measures["estimator accuracy"].greatest_risk is None


def test_an_index_whose_inputs_fell_silent_is_held_without_a_reason():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(20, **GOOD_GPS)
    tape.run(10)
    replay = tape.end()
    assert at(replay, 19.0).why["localization"] is not None
    assert at(replay, 29.0).why["localization"] is None
    assert at(replay, 29.0).risk["localization"] >= 0.5


def test_arming_modes_and_failsafes_are_events_and_in_the_samples():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(3)
    tape.heartbeat = {"custom_mode": OFFBOARD, "base_mode": ARMED}
    tape.run(3)
    tape.heartbeat |= {"system_status": int(mavlink.MAV_STATE_CRITICAL)}
    tape.run(3)
    tape.heartbeat = {}
    tape.run(3)
    replay = tape.end()
    assert events(replay, "autopilot", "mode", "armed", "failsafe") == [
        ("autopilot", "px4, system 1"),
        ("mode", "HOLD"),
        ("mode", "OFFBOARD"),
        ("armed", "armed"),
        ("failsafe", "failsafe"),
        ("mode", "HOLD"),
        ("armed", "disarmed"),
        ("failsafe", "failsafe over"),
    ]
    assert (at(replay, 2.0).mode, at(replay, 2.0).armed) == ("HOLD", False)
    assert (at(replay, 5.0).mode, at(replay, 5.0).armed) == ("OFFBOARD", True)


def test_a_lost_fix_and_a_falling_battery_are_events():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(2, **GOOD_GPS, BATTERY_STATUS=battery(90, 1))
    tape.run(2, GPS_RAW_INT={"fix_type": 1}, BATTERY_STATUS=battery(15, 2))
    tape.run(2, **GOOD_GPS, BATTERY_STATUS=battery(5, 3))
    tape.run(2, BATTERY_STATUS=battery(90, 1))
    assert events(tape.end(), "gps", "battery") == [
        ("gps", "3D fix"),
        ("gps", "3D fix lost"),
        ("battery", "battery 0 low"),
        ("gps", "3D fix again"),
        ("battery", "battery 0 critical"),
        ("battery", "battery 0 no longer low"),
    ]


def test_a_battery_without_a_charge_state_is_low_by_its_remaining_charge():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(2, BATTERY_STATUS=battery(21))
    tape.run(2, BATTERY_STATUS=battery(20))
    tape.run(2, BATTERY_STATUS=battery(-1))
    assert events(tape.end(), "battery") == [("battery", "battery 0 at 20%")]


def test_the_missions_state_is_that_reported_by_the_companion():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(1)
    tape.say(b"MOAR: planning inspection")
    tape.run(2)
    tape.say(b"MOAR: autopilot in failsafe, released", 4)
    tape.say(b"MOAR is no state")
    tape.say(b":")
    replay = tape.end()
    assert replay.samples[0].mission_state is None
    assert at(replay, 2.0).mission_state == "planning"
    assert replay.samples[-1].mission_state == "released"
    assert events(replay, "mission", "text") == [
        ("mission", "planning inspection"),
        ("mission", "autopilot in failsafe, released"),
        ("text", "companion info: MOAR is no state"),
        ("text", "companion info: :"),
    ]


def test_a_repeated_text_is_reported_once_in_ten_seconds():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    for _ in range(25):
        tape.run(1)
        tape.say(b"the same")
    reported_s = [event.time_s for event in tape.end().events if event.kind == "text"]
    assert reported_s == pytest.approx([1.0, 11.0, 21.0])


def test_orders_and_answers_are_events():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.record(tape.ground.command(31010, 2.0, 1.0))
    tape.record(tape.companion.acknowledge(31010, 5), tape.companion.acknowledge(31010, 1))
    tape.record(tape.ground.command(193, 0.0), tape.ground.command(31010, 9.0))
    assert events(tape.end(), "order", "answer") == [
        ("order", "exit 1 from 255/190"),
        ("answer", "in progress"),
        ("answer", "temporarily rejected"),
        ("order", "pause from 255/190"),
        ("order", "param1 9 is not a mission (0 to 4) from 255/190"),
    ]


def test_while_the_autopilot_is_silent_its_mode_is_unknown():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(2)
    for _ in range(10):
        tape.now_s += 1.0
        tape.record(tape.ground.ground_heartbeat())
    tape.run(3)
    replay = tape.end()
    assert events(replay, "link", "recording") == [
        ("link", "the autopilot is not received"),
        ("link", "the autopilot is received again"),
    ]
    assert (at(replay, 8.0).mode, at(replay, 8.0).armed) == (None, None)
    assert replay.samples[-1].mode == "HOLD"


def test_a_gap_of_minutes_ages_all_values_as_in_flight():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(10, **GOOD_GPS)
    tape.now_s += 240.0
    tape.run(1)
    replay = tape.end()
    assert replay.duration_s == pytest.approx(251.0)
    assert ("recording", "nothing was recorded for 4.0 min") in events(replay, "recording")
    assert at(replay, 200.0).mode is None
    assert at(replay, 200.0).risk["localization"] >= 0.5


@pytest.mark.slow
def test_a_long_silence_is_judged_by_its_samples_alone_with_the_same_result(monkeypatch):
    looks = []
    monkeypatch.setattr(
        player, "update", lambda *given, **named: looks.append(1) or update(*given, **named)
    )

    def flown():
        looks.clear()
        tape = Tape()
        tape.run(20, **GOOD_GPS, BATTERY_STATUS=battery(40))
        tape.now_s += 1000.37
        tape.run(20, **GOOD_GPS, BATTERY_STATUS=battery(30))
        return tape.end(), len(looks)

    quick, quick_looks = flown()
    monkeypatch.setattr(player, "_SETTLED_S", math.inf)
    slow, slow_looks = flown()
    assert slow_looks == pytest.approx(10 * slow.duration_s, abs=2)
    assert quick_looks < 0.35 * slow_looks
    assert (quick.events, quick.measures) == (slow.events, slow.measures)
    for sample, other in zip(quick.samples, slow.samples, strict=True):
        assert (sample.time_s, sample.reasons) == (other.time_s, other.reasons)
        assert sample.risk == pytest.approx(other.risk)


@pytest.mark.parametrize(
    ("step_s", "words"),
    [
        (-5.0, "the recorder's clock steps back by 5.0 s"),
        (-7000.0, "the recorder's clock steps back by 116.7 min"),
        (1e9, "the recorder's clock steps forward by 11574.1 d"),
    ],
)
def test_a_step_of_the_clock_is_reported_and_time_continues(step_s, words):
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(5)
    tape.now_s += step_s - 1.0
    tape.run(5)
    replay = tape.end()
    assert events(replay, "recording") == [("recording", words)]
    assert replay.duration_s == pytest.approx(9.0)
    times_s = [sample.time_s for sample in replay.samples]
    assert times_s == sorted(times_s)


def test_a_late_packet_is_no_step_of_the_clock():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    tape.run(5)
    tape.now_s -= 0.9
    tape.record(tape.autopilot.attitude(1.0))
    tape.now_s += 0.9
    tape.run(5)
    replay = tape.end()
    assert events(replay, "recording") == []
    assert replay.duration_s == pytest.approx(10.0)


def test_without_an_autopilot_all_values_are_unknown():
    tape = Tape()
    tape.record(tape.ground.ground_heartbeat(), tape.companion.heartbeat())
    replay = tape.end()
    assert (replay.autopilot, replay.vehicle_type) == ("unknown", None)
    assert events(replay, "recording") == [("recording", "no heartbeat of an autopilot")]


def test_a_submarine_does_not_lean_against_the_wind():
    def wind(vehicle):
        tape = Tape()
        tape.heartbeat = {
            "autopilot": int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
            "vehicle": int(vehicle),
            "base_mode": ARMED,
        }
        tape.record(tape.autopilot.heartbeat(**tape.heartbeat))
        for _ in range(40):
            tape.now_s += 0.1
            tape.record(tape.autopilot.attitude(tape.now_s - T0_S))
            tape.send("LOCAL_POSITION_NED", time_boot_ms=round(1e3 * (tape.now_s - T0_S)))
        return tape.end().samples[-1].risk["wind"]

    assert wind(mavlink.MAV_TYPE_QUADROTOR) is not None
    assert wind(mavlink.MAV_TYPE_SUBMARINE) is None


def with_random_payload(message_id, seed):
    """A packet of the autopilot with a good checksum and any content."""
    message_class = mavlink.mavlink_map[message_id]
    payload = random.Random(seed).randbytes(message_class.unpacker.size)
    header = bytes([len(payload), 0, 0, seed & 0xFF, 1, 1]) + message_id.to_bytes(3, "little")
    crc = checksum(header + payload + bytes([message_class.crc_extra]))
    return b"\xfd" + header + payload + struct.pack("<H", crc)


def test_the_json_is_finite_for_any_values_of_the_autopilot():
    tape = Tape()
    tape.record(tape.autopilot.heartbeat())
    wanted = sorted(telemetry_receiver.MESSAGE_IDS | {75, 76, 77, 253})
    for seed in range(600):
        tape.now_s = T0_S + 0.05 * seed
        tape.record(with_random_payload(wanted[seed % len(wanted)], seed))
        if seed % 20 == 0:
            tape.record(tape.autopilot.heartbeat())
    text = tape.end().to_json()
    assert len(json.loads(text)["samples"]) == 60


def test_with_a_site_the_samples_have_place_clearance_and_escape_route():
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    planner = Planner(site, VEHICLE)
    tape = Tape(Player(VEHICLE, PassiveListener(), SitePosition(planner)))
    tape.heartbeat = {"base_mode": ARMED}
    tape.record(tape.autopilot.heartbeat(**tape.heartbeat))
    here = site.frame.to_geodetic((26.0, 0.5, 5.0))
    far = site.frame.to_geodetic((26.0, 300.0, 5.0))
    for point in (here, far):
        tape.run(
            6,
            GLOBAL_POSITION_INT={
                "lat": round(point.latitude_deg * 1e7),
                "lon": round(point.longitude_deg * 1e7),
                "alt": round(point.altitude_amsl_m * 1e3),
            },
        )
    replay = tape.end()
    place = at(replay, 5.0).place
    assert place.position_m == pytest.approx((26.0, 0.5, 5.0), abs=0.1)
    cell = planner.maps.grid.cell_of((26.0, 5.0))
    distance_m = planner.maps.obstacle_distance_m[cell]
    assert place.clearance_m == pytest.approx(distance_m - VEHICLE.radius_m, abs=0.5)
    plan = planner.plan(mission=Mission.EVACUATION, start=(26.0, 5.0))
    assert place.evacuation_s == pytest.approx(plan.metrics.duration_s, rel=0.5)
    astray = at(replay, 11.0).place
    assert astray.position_m[1] == pytest.approx(300.0, abs=0.5)
    assert (astray.clearance_m, astray.evacuation_s) == (None, None)
    assert at(replay, 0.0).place is None


def played(data):
    playback = Player(VEHICLE, PassiveListener())
    for record in Tlog(data):
        playback.feed(record.time_s, record.packet)
    return playback.finish("recording")


def test_a_ground_stations_recording_of_ardupilots_failsafes():
    replay = played((DATA / "ardupilot_failsafes.tlog").read_bytes())
    assert (replay.autopilot, replay.vehicle_type) == ("ardupilot", "quadrotor")
    assert events(replay, "mode", "failsafe") == [
        ("mode", "GUIDED"),
        ("mode", "LAND"),
        ("failsafe", "failsafe"),
        ("mode", "GUIDED"),
        ("failsafe", "failsafe over"),
        ("mode", "RTL"),
        ("failsafe", "failsafe"),
        ("mode", "GUIDED"),
        ("failsafe", "failsafe over"),
        ("mode", "LAND"),
    ]
    assert ("text", "autopilot warning: Radio Failsafe") in events(replay, "text")
    assert {sample.risk["battery"] for sample in replay.samples} == {None}
    assert max(sample.risk["communication"] for sample in replay.samples) == pytest.approx(
        1.0, abs=0.01
    )


RECORDINGS = {
    f"{path.parent.name}/{path.name}": path
    for folder in ("traces/ardupilot", "traces/px4", "data/mavlink_tlog")
    for path in sorted((SHARED / folder).glob("*.tlog*"))
}


@pytest.mark.slow
@pytest.mark.recordings
@pytest.mark.skipif(not RECORDINGS, reason="no recordings beside the checkout")
@pytest.mark.parametrize("name", sampled(list(RECORDED)[::5], list(RECORDED)))
def test_a_recording_is_played_as_it_was_flown_and_can_be_drawn(name):
    data, recorded = RECORDINGS[name].read_bytes(), RECORDED[name]
    replay = played(gzip.decompress(data) if name.endswith(".gz") else data)
    assert (replay.autopilot, replay.vehicle_type) == (recorded.autopilot, recorded.vehicle_type)
    modes = [text for _, text in events(replay, "mode")]
    assert tuple(modes[:4]) == recorded.modes
    armed = [event for event in replay.events if event.kind == "armed"][:8]
    assert [event.time_s for event in armed] == pytest.approx(recorded.armed_s, abs=0.051)
    assert [event.text for event in armed] == (["armed", "disarmed"] * 4)[: len(armed)]
    unknown = {
        index
        for index in replay.samples[0].risk
        if all(sample.risk[index] is None for sample in replay.samples)
    }
    assert unknown == recorded.unknown
    answer = json.loads(replay.to_json(), parse_constant=pytest.fail)
    assert len(answer["samples"]) == int(replay.duration_s / SAMPLE_PERIOD_S) + 1
    times_s = [event["time_s"] for event in answer["events"]]
    assert times_s == sorted(times_s)
    picture = io.BytesIO()
    draw_replay(replay, picture)
    picture.seek(0)
    assert np.ptp(image.imread(picture)) > 0.0


@pytest.mark.recordings
@pytest.mark.skipif(not RECORDINGS, reason="no recordings beside the checkout")
def test_the_table_has_every_recording():
    assert set(RECORDED) == set(RECORDINGS)


@pytest.mark.slow
@pytest.mark.recordings
@pytest.mark.skipif(not RECORDINGS, reason="no recordings beside the checkout")
def test_in_px4s_battery_failsafe_the_battery_index_comes_before_the_failsafe():
    replay = played((SHARED / "traces" / "px4" / "b1_battery_drain.companion.tlog").read_bytes())
    assert events(replay, "battery", "failsafe") == [
        ("battery", "battery 0 low"),
        ("failsafe", "failsafe"),
        ("battery", "battery 0 critical"),
        ("battery", "battery 0 emergency"),
    ]
    failsafe_s = next(event.time_s for event in replay.events if event.kind == "failsafe")
    assert at(replay, failsafe_s - 5.0).risk["battery"] > 0.9
