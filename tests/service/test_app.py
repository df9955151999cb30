"""The service as a process: sockets, signals, files."""

import contextlib
import re
import resource
import shutil
import signal
import socket
from functools import partial

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.settings.config import shipped_configs
from tests.one_line import one_line
from tests.processes import companion
from tests.stopped import stopped_pipe

SITE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"


@contextlib.contextmanager
def listener():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as item:
        item.bind(("127.0.0.1", 0))
        item.settimeout(30)
        yield item, item.getsockname()[1]


def messages(data):
    codec = mavlink.MAVLink(None)
    codec.robust_parsing = True
    return codec.parse_buffer(data) or []


@pytest.mark.parametrize(
    "number", [pytest.param(signal.SIGTERM, marks=pytest.mark.slow), signal.SIGINT]
)
def test_the_service_heartbeats_as_a_path_planner_and_ends_quietly_on_a_signal(number):
    with (
        listener() as (item, port),
        companion("--connect", f"udpout:127.0.0.1:{port}", "--site", SITE) as running,
    ):
        beats = []
        while len(beats) < 3:
            beats += [
                message
                for message in messages(item.recv(4096))
                if message.get_type() == "HEARTBEAT"
            ]
        first = beats[0]
        assert (first.get_srcSystem(), first.get_srcComponent()) == (1, 195)
        assert (first.type, first.autopilot, first.base_mode) == (18, 8, 0)
        running.send_signal(number)
        _, errors = running.communicate(timeout=10)
        assert running.returncode == 0
        assert "Traceback" not in errors


@pytest.mark.slow
def test_a_log_without_a_reader_delays_neither_the_cycles_nor_the_end():
    log = stopped_pipe()
    with (
        listener() as (item, port),
        companion("--connect", f"udpout:127.0.0.1:{port}", stderr=log.writing) as running,
    ):
        beats = 0
        while beats < 3:
            beats += sum(m.get_type() == "HEARTBEAT" for m in messages(item.recv(4096)))
        running.terminate()
        assert running.wait(10) == 0
    assert log.rest() == b""


def test_without_a_site_the_service_gives_telemetry_and_risk_only():
    with (
        listener() as (item, port),
        companion("--connect", f"udpout:127.0.0.1:{port}"),
    ):
        seen = set()
        while "NAMED_VALUE_FLOAT" not in seen:
            seen |= {message.get_type() for message in messages(item.recv(4096))}


def test_a_port_in_use_is_one_line_and_status_1(capsys):
    with listener() as (_, port):
        line = one_line(["--connect", f"udp:127.0.0.1:{port}", "--site", SITE], 1, capsys)
    assert str(port) in line


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--connect", "carrier-pigeon:home"), "carrier-pigeon"),
        (("--connect", "udp:127.0.0.1:99999"), "99999"),
        (("--site", "missing.yaml"), "missing.yaml"),
        (("--config", "missing.yaml"), "missing.yaml"),
        (("--vehicle", str(SITE)), str(SITE)),
    ],
)
def test_bad_input_is_one_line_that_names_it_and_status_2(arguments, named, capsys):
    assert named in one_line(arguments, 2, capsys)


def test_the_service_records_from_the_first_heartbeat(tmp_path):
    configuration = tmp_path / "companion.yaml"
    with listener() as (item, port):
        configuration.write_text(
            f"vehicle: {shipped_configs() / 'vehicles' / 'x500.yaml'}\n"
            f"links: [{{url: 'udpout:127.0.0.1:{port}', role: autopilot}}]\n"
            f"recorder: {{directory: {tmp_path / 'flights'}}}\n"
        )
        with companion("--config", configuration) as running:
            item.recv(4096)
            running.send_signal(signal.SIGTERM)
            running.communicate(timeout=10)
    (folder,) = (tmp_path / "flights").iterdir()
    assert messages((folder / "flight.tlog").read_bytes()[8:])[0].get_type() == "HEARTBEAT"
    assert (folder / "decisions.jsonl").exists()


@pytest.mark.slow
def test_an_unusable_state_file_and_a_lost_recording_are_reported_to_the_operator(tmp_path):
    configuration, state = tmp_path / "companion.yaml", tmp_path / "state"
    state.mkdir()
    (state / "mission.json").write_text("{")
    autopilot = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 3, 3)
    wanted = {
        "MOAR: state file unusable, starting idle",
        "MOAR: recording ended: folder gone, flying on",
    }
    with listener() as (item, port):
        configuration.write_text(
            f"vehicle: {shipped_configs() / 'vehicles' / 'x500.yaml'}\n"
            f"links: [{{url: 'udpout:127.0.0.1:{port}', role: autopilot}}]\n"
            f"recorder: {{directory: {tmp_path / 'flights'}}}\n"
            f"state: {{directory: {state}}}\n"
        )
        with companion("--config", configuration):
            while wanted:
                data, place = item.recvfrom(4096)
                item.sendto(beat.pack(autopilot), place)
                shutil.rmtree(tmp_path / "flights", ignore_errors=True)
                wanted -= {
                    message.text for message in messages(data) if message.get_type() == "STATUSTEXT"
                }


@pytest.mark.slow
def test_fifty_readers_of_the_view_with_32_descriptors_cost_one_line_and_no_heartbeat(tmp_path):
    """As with `ulimit -n 32`."""
    configuration, view = tmp_path / "companion.yaml", tmp_path / "view.sock"
    with listener() as (item, port), contextlib.ExitStack() as stack:
        configuration.write_text(
            f"vehicle: {shipped_configs() / 'vehicles' / 'x500.yaml'}\n"
            f"links: [{{url: 'udpout:127.0.0.1:{port}', role: autopilot}}]\n"
            f"recorder: {{directory: {tmp_path / 'flights'}}}\n"
            f"state: {{directory: {tmp_path / 'state'}}}\n"
            f"view: {{socket: {view}}}\n"
        )
        few = partial(resource.setrlimit, resource.RLIMIT_NOFILE, (32, 32))
        with companion("--config", configuration, preexec_fn=few) as running:
            item.recv(4096)
            for _ in range(50):
                reader = stack.enter_context(socket.socket(socket.AF_UNIX))
                reader.connect(str(view))
            beats = 0
            while beats < 3:
                beats += sum(m.get_type() == "HEARTBEAT" for m in messages(item.recv(4096)))
            running.terminate()
            _, errors = running.communicate(timeout=10)
    assert running.returncode == 0
    (warning,) = [line for line in errors.splitlines() if not line.startswith("INFO ")]
    assert re.fullmatch(rf"WARNING view on {view}: more than \d+ readers are refused", warning)


def test_the_service_manager_is_notified_when_planner_and_links_are_ready(tmp_path):
    address = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager, listener() as (_, port):
        manager.bind(address)
        manager.settimeout(30)
        with companion(
            "--connect", f"udpout:127.0.0.1:{port}", environment={"NOTIFY_SOCKET": address}
        ) as running:
            assert manager.recv(64) == b"READY=1"
            running.terminate()
            assert manager.recv(64) == b"STOPPING=1"
