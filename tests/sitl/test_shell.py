"""The process: arguments, sockets, pacing, the truth log."""

import contextlib
import csv
import os
import resource
import signal
import socket
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.ports import Url
from sitl.shell import read_arguments

ROOT = Path(__file__).parents[2]


def _sitl(*arguments):
    return [sys.executable, "-m", "sitl", *arguments]


@contextlib.contextmanager
def _running(*arguments, title="PX4"):
    process = subprocess.Popen(
        _sitl(*arguments), cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline().startswith(f"sitl: {title} at")
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def _handle(receive, wanted, limit=20_000):
    """Read until a message of the wanted type comes; the process paces us, not a clock."""
    mav = mavlink.MAVLink(None)
    mav.robust_parsing = True
    for _ in range(limit):
        for message in mav.parse_buffer(receive()) or []:
            if message.get_type() == wanted:
                return message
    raise AssertionError(f"no {wanted}")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["--home", "1,2"], "--home '1,2': must be LAT,LON,ALT or LAT,LON,ALT,YAW"),
        (["--home", "95,2,3"], "latitude within 89"),
        (["--link", "companion"], "must be NAME=URL"),
        (["--link", "a=udp:nowhere"], "must be udpin:HOST:PORT"),
        (["--link", "a=udpout:a..b:1"], "--link a: 'udpout:a..b:1': 'a..b' is no name of a host"),
        (["--link", "a=udpin:0.0.0.0:70000"], "must be udpin:HOST:PORT"),
        (["--link", "a=udpin::14550", "--link", "a=udpin::14551"], "already a link named a"),
        (["--speed", "0"], "--speed 0: must be more than 0"),
        (["--speed", "fast"], "invalid float value"),
        (["--autopilot", "apm"], "invalid choice"),
        (["--param", "NO_SUCH=1"], "no parameter is named 'NO_SUCH'"),
        (["--firmware", "4.7"], "--firmware '4.7': must be MAJOR.MINOR.PATCH"),
        (["--firmware", "1.300.0"], "must be MAJOR.MINOR.PATCH"),
        (
            ["--autopilot", "ardupilot", "--firmware", "4.7.0", "--param", "RTL_ALT=1500"],
            "no parameter is named 'RTL_ALT'",
        ),
        (["--param", "COM_OF_LOSS_T=100"], "not between 0 and 60"),
        (["--param", "COM_OF_LOSS_T"], "must be NAME=NUMBER"),
        (
            ["--autopilot", "ardupilot", "--param", "COM_OF_LOSS_T=1"],
            "no parameter is named 'COM_OF_LOSS_T'",
        ),
        (["--scenario", "/no/such.yaml"], "/no/such.yaml: cannot be read"),
        (["--lidar", "127.0.0.1:2368"], "--lidar-scene: is missing beside --lidar"),
        (["--lidar-scene", "scene.yaml"], "--lidar: is missing beside --lidar-scene"),
        (["--lidar", "2368", "--lidar-scene", "x"], "--lidar '2368': must be HOST:PORT"),
        (["--lidar", ":2368", "--lidar-scene", "/no/such.yaml"], "/no/such.yaml: cannot be read"),
        (["--sign-key", "/no/such.key"], "--sign-key /no/such.key: No such file or directory"),
        (["--sign-key", __file__], "must hold 32 bytes or 64 hexadecimal digits"),
    ],
)
def test_bad_arguments_give_one_line_and_status_2(capsys, arguments, problem):
    with pytest.raises(SystemExit) as caught:
        read_arguments(arguments)
    assert caught.value.code == 2
    error_text = capsys.readouterr().err
    assert problem in error_text
    assert error_text.count("\n") == 1


@pytest.mark.timeout(20)
@pytest.mark.parametrize(
    "arguments",
    [["--scenario"], ["--sign-key"], ["--lidar", "127.0.0.1:2368", "--lidar-scene"]],
    ids=lambda words: words[-1],
)
@pytest.mark.parametrize(
    ("place", "kind"), [("pipe", "a pipe"), ("/dev/zero", "a device"), ("/", "a directory")]
)
def test_what_is_no_file_is_one_line_and_status_2(
    arguments, place, kind, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    with pytest.raises(SystemExit) as caught:
        read_arguments([*arguments, place])
    assert caught.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"{place}: is {kind}, must be a file")


@pytest.mark.parametrize("arguments", [["--scenario", "a\x1b[31mb"], ["\x1b[31mb\n"]])
def test_a_name_with_control_characters_does_not_steer_the_terminal(arguments, capsys):
    with pytest.raises(SystemExit):
        read_arguments(arguments)
    (line,) = capsys.readouterr().err.splitlines()
    assert line.isprintable()


def test_the_defaults_are_px4s_ports_and_home():
    settings = read_arguments([])
    assert {name: str(url) for name, url in settings.urls.items()} == {
        "companion": "udpout:127.0.0.1:14540",
        "gcs": "udpout:127.0.0.1:14550",
    }
    assert settings.options.latitude_deg == 47.397742
    assert [link.profile for link in settings.options.links] == ["onboard", "normal"]


def test_a_home_in_the_south_west_is_taken_with_and_without_equals_sign():
    for arguments in (["--home", "-33.1,-70.2,520,90"], ["--home=-33.1,-70.2,520,90"]):
        options = read_arguments(arguments).options
        assert (options.latitude_deg, options.longitude_deg) == (-33.1, -70.2)
        assert (options.altitude_amsl_m, options.yaw_deg) == (520.0, 90.0)


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udp:0.0.0.0:14550", "udpin:0.0.0.0:14550"),
        ("udpin://:14550", "udpin:0.0.0.0:14550"),
        ("udpout:10.0.0.2:14540", "udpout:10.0.0.2:14540"),
        ("tcpin:0.0.0.0:5760", "tcpin:0.0.0.0:5760"),
        ("tcp::5760", "tcp:127.0.0.1:5760"),
    ],
)
def test_urls(text, url):
    assert str(Url.parse(text)) == url


def test_an_unknown_peer_exchanges_packets_with_the_process_over_real_udp(tmp_path):
    log = tmp_path / "truth.csv"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.settimeout(20.0)
        link = f"companion=udpout:127.0.0.1:{end.getsockname()[1]}"
        with _running("--link", link, "--speed", "10", "--truth", str(log)) as process:
            peer = {}

            def receive():
                data, peer["address"] = end.recvfrom(65535)
                return data

            heartbeat = _handle(receive, "HEARTBEAT")
            assert (heartbeat.autopilot, heartbeat.custom_mode) == (12, 0x03040000)
            mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=195)
            request = mavlink.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)
            end.sendto(request.pack(mav), peer["address"])
            assert _handle(receive, "AUTOPILOT_VERSION").flight_sw_version == 17891583
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
            assert process.stderr.read() == ""
    lines = log.read_text().splitlines()
    assert lines[0].startswith("# home latitude_deg=47.397742 longitude_deg=8.545594")
    rows = list(csv.DictReader(lines[1:]))
    assert len(rows) > 10
    assert {"time_s", "north_m", "battery_fraction", "mode"} <= set(rows[0])
    gaps = [float(b["time_s"]) - float(a["time_s"]) for a, b in pairwise(rows)]
    assert max(gaps) <= 0.1


def test_a_ground_station_connects_over_tcp_and_the_truth_survives_a_kill(tmp_path):
    log = tmp_path / "truth.csv"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with _running(
        "--link", f"gcs=tcpin:127.0.0.1:{port}", "--speed", "10", "--truth", str(log)
    ) as process:
        with socket.create_connection(("127.0.0.1", port), timeout=20.0) as end:
            end.settimeout(20.0)
            assert _handle(lambda: end.recv(4096), "HEARTBEAT").type == 2
        process.kill()
        process.wait(20)
    assert log.read_text().endswith("\n")


def test_ardupilot_is_the_other_autopilot_with_parameters_of_its_own():
    options = read_arguments(["--autopilot", "ardupilot", "--param", "GUID_TIMEOUT=0.5"]).options
    assert options.autopilot == "ardupilot"
    assert options.parameters == {"GUID_TIMEOUT": 0.5}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.settimeout(20.0)
        link = f"companion=udpout:127.0.0.1:{end.getsockname()[1]}"
        arguments = ("--autopilot", "ardupilot", "--link", link, "--speed", "10")
        with _running(*arguments, title="ArduPilot"):
            heartbeat = _handle(lambda: end.recv(65535), "HEARTBEAT")
            assert (heartbeat.autopilot, heartbeat.custom_mode) == (3, 0)


SCENE = """
name: none
frame:
  origin: {latitude_deg: 47.397742, longitude_deg: 8.545594, altitude_amsl_m: 489.4}
  azimuth_deg: 0.0
"""


@pytest.mark.slow
def test_a_lidar_sends_its_packets_in_order_from_the_start(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as end:
        end.bind(("127.0.0.1", 0))
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)  # holds all that are read
        end.settimeout(60.0)
        lidar = ("--lidar", f"127.0.0.1:{end.getsockname()[1]}", "--lidar-scene", str(scene))
        with _running(*lidar, "--link", "companion=udpout:127.0.0.1:9"):
            packets = [end.recv(4096) for _ in range(100)]
    assert {len(packet) for packet in packets} == {1206}
    times_us = [int.from_bytes(packet[1200:1204], "little") for packet in packets]
    assert times_us == [int(n * 1327.104) for n in range(8, 108)]  # from the first tick on
    assert any(packet[4:1200:3] != bytes(399) for packet in packets)  # the ground is seen


def test_without_a_lidar_no_compiler_is_loaded():
    program = "import sys, sitl.shell; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False).returncode == 0


def test_a_port_in_use_is_one_line_and_status_1():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        done = subprocess.run(
            _sitl("--link", f"gcs=udpin:127.0.0.1:{port}"),
            cwd=ROOT, capture_output=True, text=True, check=False, timeout=60,
        )  # fmt: skip
    assert done.returncode == 1
    assert f"gcs=udpin:127.0.0.1:{port}: Address already in use" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("place", "problem"),
    [("nowhere/truth.csv", "No such file or directory"), ("truth.csv", "File too large")],
)
def test_a_truth_log_that_cannot_be_written_is_one_line_and_status_1(tmp_path, place, problem):
    path = tmp_path / place
    done = subprocess.run(
        [sys.executable, "-m", "sitl", "--truth", str(path), "--speed", "50",
         "--link", "companion=udpout:127.0.0.1:9"],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096)),
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == f"sitl: --truth {path}: {problem}\n"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_at_an_unlimited_speed_the_process_can_be_stopped(number):
    with _running("--speed", "1e300", "--link", "companion=udpout:127.0.0.1:9") as process:
        process.send_signal(number)
        assert process.wait(20) == 0


@pytest.mark.parametrize(
    ("module", "loads"),
    [
        ("sitl.__main__", "sitl.scenario"),
        pytest.param(
            "sitl.demonstration.__main__", "sitl.demonstration.judge", marks=pytest.mark.slow
        ),
    ],
)
def test_an_interrupt_during_loading_is_status_1_without_output(module, loads):
    program = f"""
import os, signal, sys
class Interrupt:
    def find_spec(self, name, *_):
        if name == {loads!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupt())
from {module} import main
main()
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "")


def test_over_udp_each_message_is_a_datagram_as_from_px4():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as companion:
        companion.bind(("127.0.0.1", 0))
        companion.settimeout(20)
        with _running("--link", f"companion=udpout:127.0.0.1:{companion.getsockname()[1]}"):
            for _ in range(500):
                packet = companion.recv(4096)
                assert packet[0] == 0xFD
                assert len(packet) == 12 + packet[1]
