"""The service on a signed link, over real sockets; pymavlink signs at the other end."""

from __future__ import annotations

import contextlib
import json
import math
import signal
import time

import pytest
import yaml
from pymavlink import mavutil

from moar_companion.settings.config import shipped_configs
from sitl.demonstration.processes import free_ports
from tests.processes import companion, simulator

from ..mavlink.signed import OTHER_SECRET, SECRET, found_in

PATIENCE_S = 30.0
UNSUPPORTED = 3
FAR_AHEAD = 1 << 46


def timestamp_of(message):
    return int.from_bytes(message.get_msgbuf()[-12:-6], "little")


class Flown:
    """The folder of a service, and an autopilot by mavutil on its link."""

    def __init__(self, folder, port, **config):
        self.folder = folder
        self.key = folder / "secret" / "signing.key"
        self.key.parent.mkdir()
        self.key.write_text(SECRET.hex() + "\n")
        self.key.chmod(0o400)
        self.file = folder / "companion.yaml"
        values = {
            "vehicle": str(shipped_configs() / "vehicles" / "x500.yaml"),
            "links": [{"url": f"udpout:127.0.0.1:{port}", "signed": True}],
            "signing": {"key_file": str(self.key)},
            "recorder": {"directory": "flights"},
            "state": {"directory": "state"},
            **config,
        }
        self.file.write_text(yaml.safe_dump(values))
        self.link = mavutil.mavlink_connection(
            f"udpin:127.0.0.1:{port}", source_system=1, source_component=1, dialect="all"
        )
        self.sign(SECRET)

    def sign(self, secret):
        self.link.setup_signing(secret, sign_outgoing=True, link_id=5)

    def beat(self):
        self.link.mav.heartbeat_send(2, 12, 81, 3 << 16, 3)

    def handle(self, name, **fields):
        """The next message of the companion with these fields; sends heartbeats meanwhile."""
        until_s = time.monotonic() + PATIENCE_S
        beat_s = math.inf
        while time.monotonic() < until_s:
            message = self.link.recv_match(blocking=True, timeout=0.1)
            if time.monotonic() >= beat_s:
                beat_s = time.monotonic() + 0.3
                self.beat()
            if message is None or message.get_srcComponent() != 195:
                continue
            beat_s = min(beat_s, time.monotonic())
            message_fields = message.to_dict()
            if message_fields["mavpackettype"] == name and fields.items() <= message_fields.items():
                return message
        raise AssertionError(f"no {name} {fields}")

    def command(self, command):
        self.link.mav.command_long_send(1, 195, command, 0, *[0.0] * 7)

    def stamps(self):
        return json.loads((self.folder / "state" / "signing.json").read_text())["timestamps"]

    def written(self):
        """All that the service has written."""
        files = [path for path in self.folder.rglob("*") if path.is_file() and path != self.key]
        return b"\n".join(path.read_bytes() for path in files)


@pytest.fixture
def flown(tmp_path, monkeypatch):
    monkeypatch.setenv("MAVLINK20", "1")
    (port,) = free_ports(1)
    item = Flown(tmp_path, port)
    with contextlib.closing(item.link):
        yield item


@pytest.mark.slow
def test_signed_packets_are_answered_signed_and_no_output_shows_the_key(flown):
    with companion("--config", flown.file) as running:
        beat = flown.handle("HEARTBEAT")
        assert beat.get_signed()
        assert beat.get_link_id() == 0
        assert flown.handle("COMMAND_LONG", command=511).get_signed()
        flown.command(42)
        assert flown.handle("COMMAND_ACK", command=42, result=UNSUPPORTED).get_signed()
        flown.sign(OTHER_SECRET)
        flown.command(43)
        flown.sign(SECRET)
        words = "MOAR: 1 packet refused: wrong signature"
        assert flown.handle("STATUSTEXT", text=words).get_signed()
        flown.link.mav.signing.sign_outgoing = False
        flown.command(44)
        flown.link.mav.signing.sign_outgoing = True
        assert flown.handle("STATUSTEXT", text="MOAR: 1 packet refused: unsigned").get_signed()
        flown.link.mav.setup_signing_send(1, 195, list(OTHER_SECRET), 1)
        flown.command(45)
        assert flown.handle("COMMAND_ACK", command=45).get_signed()
        last = timestamp_of(flown.handle("HEARTBEAT"))
        running.send_signal(signal.SIGTERM)
        output, errors = running.communicate(timeout=10)
    assert "refused: wrong signature" in errors
    everything = flown.written() + (output + errors).encode()
    assert found_in(everything) == []
    assert found_in(everything, OTHER_SECRET) == []
    (ahead,) = flown.stamps().values()
    assert 0 < ahead - last <= 1_000_000  # 10 s: five ahead, written every few seconds


@pytest.mark.slow
def test_a_service_that_is_restarted_continues_after_the_stored_time_stamps(flown):
    with companion("--config", flown.file) as running:
        flown.handle("HEARTBEAT")
        running.terminate()
        running.communicate(timeout=10)
    state = flown.folder / "state" / "signing.json"
    content = json.loads(state.read_text())
    content["timestamps"] = dict.fromkeys(content["timestamps"], FAR_AHEAD)
    state.write_text(json.dumps(content))
    with companion("--config", flown.file):
        beat = flown.handle("HEARTBEAT")
        while timestamp_of(beat) < FAR_AHEAD:
            beat = flown.handle("HEARTBEAT")
    assert FAR_AHEAD < timestamp_of(beat) < FAR_AHEAD + 1000


@pytest.mark.slow
def test_a_key_file_that_other_users_can_read_is_one_line_and_status_2(flown):
    flown.key.chmod(0o644)
    for arguments in (("--config", flown.file), ("check", "--config", flown.file, "--files")):
        with companion(*arguments) as running:
            _, errors = running.communicate(timeout=30)
        assert running.returncode == 2
        assert errors.count("\n") == 1
        assert f"{flown.file}: signing.key_file: is '{flown.key}': is open to group" in errors
        assert found_in(errors.encode()) == []


@pytest.mark.slow
def test_a_link_of_the_command_line_stays_signed_when_the_configuration_has_it_signed(flown):
    (link,) = yaml.safe_load(flown.file.read_text())["links"]
    with companion("--config", flown.file, "--connect", link["url"]):
        assert flown.handle("HEARTBEAT").get_signed()


@pytest.mark.slow
def test_the_fake_autopilot_and_the_service_exchange_packets_on_a_signed_link(flown):
    port, operator_port = free_ports(2)
    values = yaml.safe_load(flown.file.read_text())
    values["links"] = [{"url": f"udp:127.0.0.1:{port}", "signed": True}]
    flown.file.write_text(yaml.safe_dump(values))
    with (
        simulator(
            *("--link", f"companion=udpout:127.0.0.1:{port}"),
            *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
            *("--sign-key", flown.key),
        ),
        companion("--config", flown.file) as running,
    ):
        received = ""
        while "autopilot px4, system 1" not in received:
            received = running.stderr.readline()
            assert received
        running.terminate()
        _, errors = running.communicate(timeout=10)
    assert "refused" not in errors
