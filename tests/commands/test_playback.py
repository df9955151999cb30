"""Recordings for the page: time lines, and frames that lead to the statuses as they were."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap.writer import Writer

from moar_companion.commands.playback import McapPlayback, ReplayPlayback
from moar_companion.commands.replay import played
from moar_companion.errors import InputError
from moar_companion.service.recording.schemas import CALLS
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from tests.flights.recorded import recorded_flight
from tests.service.page.merging import merged

FAILSAFES = Path(__file__).parents[1] / "data" / "ardupilot_failsafes.tlog"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Folder of a flight of 14 s, and its statuses by the wall clock."""
    return recorded_flight(tmp_path_factory.mktemp("flights"), cycles=700)


@pytest.fixture
def playback(recorded):
    return McapPlayback(recorded[0] / "flight.mcap")


def states(frames):
    """The state after each frame, by its time."""
    state = None
    for frame in frames:
        state = frame["all"] if "all" in frame else merged(state, frame["changed"])
        yield frame["time_s"], state


@pytest.mark.slow
def test_frames_lead_to_the_statuses_as_they_were_recorded(playback, recorded):
    began_s = playback.summary()["began_s"]
    found = dict(states(playback.frames(0.0, 100.0)))
    assert len(found) == len(recorded[1]) >= 28
    for time_s, state in found.items():
        was = recorded[1][round(began_s + time_s, 3)]
        assert state["mission"]["state"] == was["mission"]["state"]
        place = was["aircraft"]["position_m"]
        assert state["aircraft"]["position_m"] == pytest.approx(place, abs=1e-6)
        assert corners(state.get("plan")) == pytest.approx(corners(was["plan"]), abs=1e-6)
        assert state["risk"]["wind"]["words"] == was["risk"]["wind"]["words"]
    assert {state["mission"]["state"] for state in found.values()} >= {"planning", "flying"}


def corners(plan):
    """The path of a plan as numbers."""
    path = [] if plan is None else plan["path"]
    return [point[name] for point in path for name in ("x_m", "z_m", "speed_mps")]


@pytest.mark.slow
def test_frames_of_a_time_are_as_those_of_the_whole_flight(playback):
    whole = dict(states(playback.frames(0.0, 100.0)))
    part = dict(states(playback.frames(6.1, 9.0)))
    first = min(part)
    assert 5.6 <= first <= 6.1
    assert len(part) == 7
    for time_s, state in part.items():
        assert state["mission"] == whole[time_s]["mission"]
        assert state.get("before") == whole[time_s].get("before")
    (last,) = playback.frames(500.0, 600.0)
    assert last["time_s"] == max(whole)


@pytest.mark.slow
def test_the_time_line_has_events_and_the_flown_path_in_order(playback):
    summary = json.loads(json.dumps(playback.summary(), allow_nan=False))
    assert summary["duration_s"] == pytest.approx(14.0, abs=0.1)
    times_s = [event["time_s"] for event in summary["events"]]
    assert times_s == sorted(times_s)
    kinds = {event["kind"] for event in summary["events"]}
    assert kinds >= {"order", "state", "text", "plan", "answer"}
    texts = [event["text"] for event in summary["events"]]
    assert "planning -> ready" in texts
    assert [place[0] for place in summary["flown"]] == pytest.approx(range(14), abs=0.6)


@pytest.mark.slow
def test_a_recording_has_its_site_and_its_vehicle(playback):
    assert playback.vehicle.name == "X500"
    assert playback.site()["site"]["name"] == "315 kV double circuit"
    assert playback.site()["maps"]["columns"] == 100


@pytest.mark.slow
def test_a_recording_that_is_cut_is_played_to_its_last_whole_chunk(recorded, tmp_path, playback):
    whole = (recorded[0] / "flight.mcap").read_bytes()
    cut = tmp_path / "flight.mcap"
    cut.write_bytes(whole[: len(whole) * 2 // 3])
    shorter = McapPlayback(cut)
    assert 1.0 < shorter.summary()["duration_s"] < playback.summary()["duration_s"]
    assert len(shorter.frames(0.0, 100.0)) > 2


@pytest.mark.slow
def test_a_recording_in_parts_is_one_time_line(recorded, tmp_path, playback):
    whole = (recorded[0] / "flight.mcap").read_bytes()
    for name in ("flight.mcap", "flight-2.mcap"):
        (tmp_path / name).write_bytes(whole)
    both = McapPlayback(tmp_path / "flight.mcap").summary()
    assert len(both["events"]) == 2 * len(playback.summary()["events"])


@pytest.mark.parametrize(
    "content", [b"", b"no mcap", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + b"x" * 99]
)
def test_a_file_that_is_no_recording_is_one_line(tmp_path, content):
    path = tmp_path / "flight.mcap"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"flight\.mcap"):
        McapPlayback(path)


def test_an_mcap_of_another_program_is_one_line(tmp_path):
    path = mcap(tmp_path, ("/imu", b"\x00\x01"), ("/aircraft", b"\x00\x01"))
    with pytest.raises(InputError, match=r"flight\.mcap: has no /machine/calls, must be this"):
        McapPlayback(path)


def test_messages_of_another_version_are_left_out_and_the_others_are_played(tmp_path):
    old_calls = json.dumps({"calls": [["start", [], 0.0, None]]}).encode()
    path = mcap(
        tmp_path,
        (CALLS, old_calls),
        (CALLS, b"[]"),
        ("/decision", b'{"kind": "state", "time_s": 2.0, "data": {}}'),
        ("/aircraft", b"null"),
        ("/decision", b'{"kind": "text", "time_s": 5.0, "data": {"text": "holding"}}'),
        ("/mission", b'{"state": "idle"}'),
    )
    playback = McapPlayback(path)
    summary = playback.summary()
    assert summary["duration_s"] == 5.0
    assert [event["text"] for event in summary["events"]] == ["holding"]
    assert [frame["time_s"] for frame in playback.frames(0.0, 10.0)] == [5.0]
    assert (playback.site(), playback.vehicle) == (None, None)


def test_a_recording_that_is_removed_meanwhile_is_one_line(tmp_path):
    path = mcap(tmp_path, (CALLS, b'{"calls": []}'), ("/mission", b'{"state": "idle"}'))
    playback = McapPlayback(path)
    path.unlink()
    with pytest.raises(InputError, match=r"flight\.mcap: no such file"):
        playback.frames(0.0, 1.0)


def mcap(folder, *messages):
    """An .mcap with messages, (topic, content), a second apart and each in a chunk of its own."""
    path = folder / "flight.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1)
        writer.start()
        for number, (topic, content) in enumerate(messages):
            channel = writer.register_channel(topic, "json", 0)
            time_ns = number * 1_000_000_000
            writer.add_message(channel, time_ns, content, time_ns)
        writer.finish()
    return path


@pytest.mark.slow
def test_other_recordings_are_played_as_far_as_they_tell():
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "linedrone.yaml")
    playback = ReplayPlayback(played(str(FAILSAFES), vehicle), None)
    summary = json.loads(json.dumps(playback.summary(), allow_nan=False))
    assert summary["duration_s"] == pytest.approx(54.1, abs=0.1)
    assert any(event["text"] == "RTL" for event in summary["events"])
    found = dict(states(playback.frames(30.0, 45.0)))
    assert 29.0 <= min(found) <= 30.0
    modes = {state["autopilot"]["mode"] for time_s, state in found.items() if time_s < 37.0}
    assert "RTL" not in modes
    assert "RTL" in {state["autopilot"]["mode"] for state in found.values()}
    assert playback.site() is None
    assert len(playback.frames(500.0, 501.0)) == 1
