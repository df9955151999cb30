"""A real ArduPilot receives a key, and flies with the service on signed links alone.

PX4 v1.17 has no signatures; the fake autopilots fly on signed links in tests/scenarios.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import socket
import time

import pytest
import yaml
from pymavlink.dialects.v20 import all as mavlink

from tests.mavlink.peer import Peer
from tests.mavlink.signed import found_in

from .kinds import KINDS
from .rig import Rig

RELEASE = 4
EPOCH_S = 1_420_070_400
ARDUPILOT = KINDS["real-ardupilot"]


def sign(rig, secret):
    """The operator sends the key to the disarmed autopilot on its first port; then all sign."""
    operator, timestamp = rig.operator, int((time.time() - EPOCH_S) * 100_000)
    operator._send(mavlink.MAVLink_setup_signing_message(1, 1, list(secret), timestamp))
    signing = operator._codec.signing
    signing.secret_key, signing.timestamp = secret, timestamp
    signing.link_id, signing.sign_outgoing = 200, True
    key = rig.folder / "signing.key"
    key.write_bytes(secret)
    key.chmod(0o400)
    values = yaml.safe_load(rig.service._config.read_text())
    values["links"][0]["signed"] = True
    values["signing"] = {"key_file": "signing.key"}
    rig.service._config.write_text(yaml.safe_dump(values))


@pytest.mark.slow
@pytest.mark.real_time
@pytest.mark.real_autopilot
@pytest.mark.skipif(ARDUPILOT.missing is not None, reason=str(ARDUPILOT.missing))
def test_a_real_ardupilot_flies_on_signed_links(tmp_path):
    secret = hashlib.sha256(os.urandom(32)).digest()
    with contextlib.ExitStack() as stack:
        rig = Rig(ARDUPILOT, tmp_path, stack)
        rig.boot()
        sign(rig, secret)
        rig.start_service()
        rig.take_off()
        rig.begin(index=0)
        rig.watch(3.0)
        assert not any("refused" in text for text in rig.operator.texts)
        stranger = Peer(255, 190)
        (link,) = yaml.safe_load(rig.service._config.read_text())["links"]
        port = int(link["url"].rpartition(":")[2])
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as item:
            item.sendto(stranger.command(31010, RELEASE), ("127.0.0.1", port))
            words = "MOAR: 1 packet refused: unsigned"
            rig.wait_for(words, lambda: rig.operator.has_received(words), 5.0)
        rig.watch(3.0)
        assert rig.decisions.state in {"flying", "at_target"}
        rig.land()
        rig.service.end(15)
    assert "Traceback" not in rig.service.log()
    (recording,) = tmp_path.glob("flight_*")
    packets = (recording / "flight.tlog").read_bytes()
    count, position = 0, 0
    while position < len(packets):
        start = position + 8
        assert packets[start] == 0xFD
        assert packets[start + 2] == 1
        position = start + packets[start + 1] + 25
        count += 1
    assert count > 1000
    ours = [recording / "flight.tlog", recording / "decisions.jsonl", tmp_path / "companion.log"]
    ours.append(tmp_path / "state" / "signing.json")
    assert found_in(b"\n".join(path.read_bytes() for path in ours), secret) == []
