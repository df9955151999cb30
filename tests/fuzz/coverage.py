"""Coverage-guided input for codec and session, by atheris (libFuzzer).

An input is a list of operations: a byte for the kind, then its data. Half of them are frames with
a correct checksum, which no fuzzer finds by itself.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from pathlib import Path
from random import Random

try:
    import atheris
except ImportError:  # the extra `fuzz`; single inputs need no atheris
    atheris = None

INSTRUMENTED = ["moar_companion.mavlink"]
with atheris.instrument_imports(INSTRUMENTED) if atheris else contextlib.nullcontext():
    from moar_companion.mavlink.dialect import mavlink
    from moar_companion.mavlink.session import Session, SystemStatus
    from moar_companion.mavlink.signing import LinkSigning, SigningKey
    from moar_companion.settings.config import LinkRole

    from .frames import OURS, frame, hostile_payload, shape_of

SECRET = bytes(range(32))
TIMESTAMP = 10**12
LINKS = {
    "udp:127.0.0.1:14540": LinkRole.AUTOPILOT,
    "tcp:127.0.0.1:5760": LinkRole.AUTOPILOT,
    "udp:0.0.0.0:14551": LinkRole.OPERATOR,
}
HOME, _, SIGNED = LINKS
SOURCES = [(1, 1), (1, 1), (1, 1), (255, 190), (42, 1), (2, 1), (51, 68), (0, 0), OURS]
ADDRESSES = [("10.0.0.2", 14580), ("10.0.0.3", 14550), ("10.0.0.66", 4242), None]
STEPS_S = (0.0, 0.001, 0.02, 0.5, 4.0, 20.0)


def new_session() -> Session:
    """A session that has requested the fence and parameters, so that it accepts their messages."""
    signing = {SIGNED: LinkSigning(SigningKey(SECRET), link_id=2, timestamp=TIMESTAMP)}
    session = Session(links=LINKS, signing=signing)
    session.requests.want_parameters(("GF_ACTION", "COM_OBL_RC_ACT"))
    session.requests.want_fence()
    return session


SHAPES = [
    shape_of(mavlink.mavlink_map[number]) for number in sorted(new_session()._codecs[HOME]._wanted)
]


def feed(data: bytes) -> None:
    """Feeds one input into one session. An exception of the session is a finding."""
    session, now_s, at = new_session(), 10.0, 0
    while at + 4 <= len(data):
        kind, where, step, what = data[at : at + 4]
        at += 4
        link = [*LINKS][where % len(LINKS)]
        address = ADDRESSES[where // 4 % len(ADDRESSES)] if link.startswith("udp") else None
        now_s += STEPS_S[step % len(STEPS_S)]
        if kind % 2:
            shape = SHAPES[what % len(SHAPES)]
            size = shape.message_class.unpacker.size
            payload = data[at : at + size].ljust(size, b"\0")
            signed = (SECRET, TIMESTAMP + step) if link == SIGNED and kind & 2 else None
            source = SOURCES[where // 16 % len(SOURCES)]
            piece = frame(shape.message_class, payload, source, kind // 4, signed)
        else:
            size = what
            piece = data[at : at + size]
        at += size
        session.receive(link, piece, now_s, address)
        session.tick(now_s, SystemStatus.ACTIVE)
        if session.autopilot is not None and kind & 64:
            session.send_setpoint((0.0, 0.0, -5.0), (1.0, 0.0, 0.0), 0.0, now_s)
        session.events_received()
        session.received_packets()
        session.data_to_send()


def seeds() -> list[bytes]:
    """Initial inputs: each message alone, after a heartbeat of the autopilot."""
    pick = Random(1)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 209, 6 << 16, 4, 3)
    packed = bytes(heartbeat.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))
    begin = bytes((0, 0, 2, len(packed))) + packed
    return [
        begin + bytes((1, 0, 2, index)) + hostile_payload(pick, shape, None, 1.0)
        for index, shape in enumerate(SHAPES)
    ]


def run(seconds: int) -> int:
    """Runs libFuzzer in a separate process; exit status 77 after an exception."""
    with tempfile.TemporaryDirectory() as folder:
        for number, seed in enumerate(seeds()):
            Path(folder, str(number)).write_bytes(seed)
        command = [sys.executable, "-m", __name__, f"-max_total_time={seconds}", folder]
        return subprocess.run(command, check=False).returncode


if __name__ == "__main__":
    atheris.Setup([*sys.argv[:1], "-max_len=2048", "-timeout=5", "-seed=1", *sys.argv[1:]], feed)
    atheris.Fuzz()
