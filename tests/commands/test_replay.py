"""`moar-companion replay`: its summary, its files, and the input that it refuses."""

from __future__ import annotations

import gzip
import json
import random
import struct
from pathlib import Path

import pytest
from matplotlib import image

from moar_companion.commands import cli
from moar_companion.mavlink.tlog import Tlog
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from sitl.wire import packets
from tests.flights.airs import AirFlight, airframe_of
from tests.flights.operator import Manner

DATA = Path(__file__).parents[1] / "data"
FAILSAFES = DATA / "ardupilot_failsafes.tlog"
SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
SAMPLE_KEYS = {"time_s", "risk", "armed", "mode", "mission_state"}
KEYS = {"recording", "autopilot", "duration_s", "samples", "events", "inputs"}


@pytest.fixture
def replay(capsys):
    """Run the command, which must succeed. Return its output."""

    def run(recording, *options):
        status = cli.main(["replay", str(recording), *options])
        out, err = capsys.readouterr()
        assert (status, err) == (0, "")
        return out

    return run


@pytest.fixture
def refused(capsys):
    """Run the command; the one line of its refusal."""

    def run(*words):
        status = cli.main(["replay", *map(str, words)])
        out, err = capsys.readouterr()
        assert (status, out, err.count("\n")) == (2, "", 1)
        return err

    return run


def test_a_summary_gives_the_aircraft_the_risks_and_the_events(replay):
    lines = replay(FAILSAFES).splitlines()
    assert lines[0].startswith("ardupilot_failsafes.tlog: ardupilot quadrotor, 54.1 s")
    assert any("battery" in line and "unknown" in line for line in lines)
    assert any("communication" in line and "never known: radio margin" in line for line in lines)
    assert any("37.7 s" in line and "mode" in line and "RTL" in line for line in lines)


def test_the_json_is_the_contract(replay):
    answer = json.loads(replay(FAILSAFES, "--json", "-"), parse_constant=pytest.fail)
    assert set(answer) >= KEYS
    assert (answer["recording"], answer["autopilot"]) == (FAILSAFES.name, "ardupilot")
    assert all(set(sample) >= SAMPLE_KEYS for sample in answer["samples"])
    assert list(answer["samples"][0]["risk"]) == [
        "wind",
        "communication",
        "localization",
        "battery",
    ]
    assert all(set(event) == {"time_s", "kind", "text"} for event in answer["events"])
    assert answer["inputs"]["gps"]["messages"] == 0
    assert answer["inputs"]["autopilot"]["messages"] > 50


def test_a_packed_recording_is_the_same_with_any_name(replay, tmp_path):
    packed = tmp_path / FAILSAFES.name
    packed.write_bytes(gzip.compress(FAILSAFES.read_bytes()))
    assert replay(packed, "--json", "-") == replay(FAILSAFES, "--json", "-")


def test_json_and_picture_are_written_beside_the_summary(replay, tmp_path):
    out = replay(FAILSAFES, "--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png"))
    assert "ardupilot" in out.splitlines()[0]
    assert json.loads((tmp_path / "a.json").read_text())["autopilot"] == "ardupilot"
    assert image.imread(tmp_path / "a.png").shape[2] == 4


def test_vehicle_and_site_are_taken(replay):
    vehicle = str(shipped_configs() / "vehicles" / "x500.yaml")
    recording = DATA / "ardupilot_boot.tlog"
    answer = json.loads(replay(recording, "--vehicle", vehicle, "--site", str(SITE), "--json", "-"))
    assert answer["vehicle"] == "X500"


@pytest.mark.parametrize("size", [3_001, 3_003])
def test_a_recording_that_ends_in_a_packet_is_played_to_its_end(replay, tmp_path, size):
    cut = tmp_path / "cut.tlog"
    cut.write_bytes(FAILSAFES.read_bytes()[:size])
    assert replay(cut).rstrip().endswith("ends in the middle of a packet")


@pytest.mark.parametrize(
    ("missing", "words"),
    [(100, "ends in the middle of a packet"), (4, "ends in the middle of the gzip file")],
    ids=["of its packets", "of its checksum alone"],
)
def test_a_packed_recording_that_is_cut_short_is_played_to_its_end(
    replay, tmp_path, missing, words
):
    cut = tmp_path / "cut.tlog.gz"
    cut.write_bytes(gzip.compress(FAILSAFES.read_bytes())[:-missing])
    lines = replay(cut).splitlines()
    assert lines[-1].endswith(words)
    whole = replay(FAILSAFES).splitlines()
    assert lines[6:-1] == whole[6 : len(lines) - 1]


@pytest.mark.parametrize("pack", [bytes, gzip.compress], ids=["as it is", "packed"])
def test_a_recording_that_would_fill_the_memory_is_refused(refused, tmp_path, monkeypatch, pack):
    content = FAILSAFES.read_bytes()
    monkeypatch.setattr("moar_companion.commands.replay._MAX_BYTES", len(content) - 1)
    path = tmp_path / "long.tlog"
    path.write_bytes(pack(content))
    assert "is too long, must have at most " in refused(path)


def test_broken_packets_are_reported(replay, tmp_path):
    broken = bytearray(FAILSAFES.read_bytes())
    packet = [record.packet for record in Tlog(bytes(broken))][20]
    broken[broken.index(packet) + len(packet) - 1] ^= 0xFF
    path = tmp_path / "broken.tlog"
    path.write_bytes(broken)
    assert "left out: broken packets 1, stray bytes 0" in replay(path)


GZIP = gzip.compress(FAILSAFES.read_bytes())
WRONG_GZIP = GZIP[:50] + bytes(50) + GZIP[100:]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\x1a\n" + bytes(1000), "is no recording"),
        (b"ULog\x01\x12\x35\x01" + random.Random(1).randbytes(10_000), "is no sound ULog"),
        (b"time,roll\n" * 100, "is no recording"),
        (random.Random(2).randbytes(100_000), "is no recording"),
        (GZIP[:5], "is empty"),
        (WRONG_GZIP, "is no sound gzip file"),
        (gzip.compress(b""), "is empty"),
    ],
    ids=["empty", "picture", "ulog", "table", "noise", "cut gzip", "broken gzip", "gzip of none"],
)
def test_a_file_that_is_no_recording_is_refused_in_one_line(refused, tmp_path, content, words):
    path = tmp_path / "wrong.tlog"
    path.write_bytes(content)
    line = refused(path)
    assert words in line
    assert str(path) in line


def test_a_path_that_is_no_file_is_refused_in_one_line(refused, tmp_path):
    assert "no such file" in refused(tmp_path / "none.tlog")
    assert "is a directory" in refused(tmp_path)
    assert "is a device" in refused("/dev/zero")


def test_impossible_outputs_are_refused_before_anything_is_read(refused, tmp_path):
    recording = tmp_path / "flight.tlog"
    assert "--plot" in refused(recording, "--plot", "-")
    assert "must end in .png" in refused(recording, "--plot", "a.svg")
    assert "the file of the recording" in refused(recording, "--json", recording)
    assert "no directory" in refused(recording, "--json", tmp_path / "no" / "a.json")
    assert "--nonsense" in refused(recording, "--nonsense")


def recorded(flight, path):
    """Received packets of the companion in a lockstep flight, as a recording."""
    rows = [(time_s, packet) for time_s, data in flight.received for packet in packets(data)]
    path.write_bytes(
        b"".join(struct.pack(">Q", round(1e6 * (1e9 + time_s))) + data for time_s, data in rows)
    )
    return path


@pytest.mark.slow
def test_a_calm_flight_measures_the_drag_in_lines_for_the_vehicle_file(replay, tmp_path):
    flight = AirFlight(Manner.ARDUPILOT)
    for north_m, speed_mps in ((20.0, 2.5), (0.0, 2.5), (25.0, 5.0), (0.0, 5.0)):
        flight.fly_to((north_m, 0.0), speed_mps)
    lines = replay(recorded(flight, tmp_path / "calm.tlog"), "--fit-drag")
    vehicle = (shipped_configs() / "vehicles" / "x500.yaml").read_text()
    (tmp_path / "measured.yaml").write_text(vehicle.replace("risk:\n", lines))
    risk = Vehicle.load(tmp_path / "measured.yaml").risk
    true = airframe_of(Manner.ARDUPILOT, 1.0)
    for speed_mps in (2.5, 5.0):
        assert risk.drag_per_s + risk.drag_per_m * speed_mps == pytest.approx(
            true.drag_per_s + true.drag_per_m * speed_mps, rel=0.08
        )


def test_a_drag_fit_without_the_needed_data_names_what_is_missing(refused):
    line = refused(FAILSAFES, "--fit-drag")
    assert "ardupilot_failsafes.tlog" in line
    assert "drag" in line
    assert "--json" in refused(FAILSAFES, "--fit-drag", "--json", "-")


def ulog(*messages):
    """A ULog of these messages: kind and content."""
    packed = (struct.pack("<HB", len(body), ord(kind)) + body for kind, body in messages)
    return b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 10**6) + b"".join(packed)


def a_flight():
    """Two seconds armed in POSCTL, with a text."""
    formats = (
        b"vehicle_status:uint64_t timestamp;uint8_t nav_state;uint8_t arming_state;"
        b"uint8_t system_type;uint8_t system_id;"
    )
    data = [("D", struct.pack("<HQ4B", 0, 10**6 + 10**5 * step, 2, 2, 2, 1)) for step in range(21)]
    text = ("L", struct.pack("<BQ", ord("4"), 2 * 10**6) + b"a warning")
    return [("F", formats), ("A", struct.pack("<BH", 0, 0) + b"vehicle_status"), *data, text]


def test_px4s_own_log_is_replayed(replay, tmp_path):
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulog(*a_flight()))
    lines = replay(path).splitlines()
    assert lines[0].startswith("flight.ulg: px4 quadrotor, 2.0 s")
    assert any("mode" in line and "POSCTL" in line for line in lines)
    assert any("autopilot warning: a warning" in line for line in lines)
    answer = json.loads(replay(path, "--json", "-"), parse_constant=pytest.fail)
    assert answer["inputs"]["autopilot"]["messages"] == 21


def test_a_log_that_is_cut_short_is_replayed_to_its_end(replay, tmp_path):
    whole = ulog(*a_flight())
    path = tmp_path / "flight.ulg"
    for size in range(len(whole) - 60, len(whole)):
        path.write_bytes(whole[:size])
        assert "px4 quadrotor" in replay(path)


def test_a_topic_without_times_is_left_out(replay, tmp_path):
    path = tmp_path / "flight.ulg"
    path.write_bytes(
        ulog(
            ("F", b"wind:uint64_t timestamq;float windspeed_north;"),
            *a_flight(),
            ("A", struct.pack("<BH", 0, 1) + b"wind"),
            ("D", struct.pack("<HQf", 1, 2 * 10**6, 3.0)),
        )
    )
    lines = replay(path).splitlines()
    assert lines[0].startswith("flight.ulg: px4 quadrotor, 2.0 s")
    assert any("parts of the log are broken, and left out" in line for line in lines)


@pytest.mark.parametrize(
    "content",
    [
        ulog(),
        ulog(("F", b"no format at all")),
        ulog(("Z", b"unknown"), *a_flight()),
        ulog(("F", b""), *a_flight()),
        ulog(*a_flight())[:40],
    ],
    ids=["no definitions", "broken format", "unknown kind", "empty definition", "cut definition"],
)
def test_a_broken_log_is_refused_in_one_line(refused, tmp_path, content):
    path = tmp_path / "flight.ulg"
    path.write_bytes(content)
    assert "is no sound ULog" in refused(path)


def test_every_sample_has_the_reasons_and_the_resulting_weights(replay):
    answer = json.loads(replay(FAILSAFES, "--json", "-"), parse_constant=pytest.fail)
    for sample in answer["samples"]:
        assert list(sample["reasons"]) == list(sample["risk"])
        for name, words in sample["reasons"].items():
            assert words.startswith(f"{name} ")
        assert sum(sample["weights"]["adjusted"].values()) == pytest.approx(1.0, abs=0.002)
    reported = [event["text"] for event in answer["events"] if event["kind"] == "risk"]
    assert any(
        text.startswith("communication to 0.67: ground station silence ") for text in reported
    )
