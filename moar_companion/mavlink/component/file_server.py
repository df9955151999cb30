"""MAVLink FTP: requests of ground stations to replies, on files that are in memory alone. No I/O.

Only the given files can be read, and nothing can be written. A path's leading slashes are left
out: QGroundControl asks for `//general.json.xz` when a URI has a slash after its component.

A session has the number that the ground station has given it when it opened a file, as with
ArduPilot: MAVProxy expects that, and has several; QGroundControl and MAVSDK have one, 0. A client
whose reply was lost repeats its request, MAVSDK with a new number, and a network doubles packets
and exchanges their order. Reading changes nothing, so that a repeat is answered again. A request
from before the one that has opened the file neither closes nor replaces it.

A burst ends after two seconds, since pymavlink gives up 3.7 s after its last request. It does not
end with a packet shorter than was asked for, which pymavlink takes for the end of the file.

Source: https://mavlink.io/en/services/ftp.html, and the clients in QGroundControl (FTPManager.cc),
MAVSDK (mavlink_ftp_client.cpp) and pymavlink (mavftp.py).
"""

from __future__ import annotations

import enum
import math
import struct
import zlib
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from ..commands import Sender
from ..dialect import Message, create, mavlink
from .component_service import Asker
from .link_budget import OVERHEAD_BYTES

_HEADER = struct.Struct("<HBBBBBBI")
"""Sequence, session, opcode, size, opcode of the request, burst complete, padding, offset."""
_PAYLOAD_BYTES = 251
_MOST_DATA_BYTES = _PAYLOAD_BYTES - _HEADER.size
_AROUND_DATA_BYTES = OVERHEAD_BYTES + 3 + _HEADER.size
"""Bytes of a packet around the data: the frame, three of the target, the header."""
_LEAST_DATA_BYTES = 80
"""Size of a piece that pymavlink asks for. It takes a shorter one as a file that has changed, and
ends the download; so no link gets shorter pieces."""

_IDLE_S = 30.0
"""Time without a request after which an open file is closed: MAVSDK gives up after 10 s."""
_MOST_SESSIONS = 16
_MOST_OF_SENDER = 5
"""Limit of the files that a ground station has open: ArduPilot's, and MAVProxy's own."""
_MOST_READS = 8
"""Limit of the reads of a session that wait for room: pymavlink has five under way."""
_LATE_S = 2.0
"""Greatest delay of a request on its way. A client that starts again with low numbers, with a file
still open, repeats its requests for longer."""
_BURST_S = 2.0
"""Time after which a burst ends: the client asks for the next one."""
_DOUBLED_S = 0.3
"""Time in which the network's own copies of a packet arrive. Clients repeat after 0.5 s or more."""


class Opcode(enum.IntEnum):
    """MAV_FTP_OPCODE."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(enum.IntEnum):
    """MAV_FTP_ERR: reasons of a NAK."""

    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


_WRITES = frozenset(range(Opcode.CREATE_FILE, Opcode.RENAME + 1))


def file_crc32(data: bytes) -> int:
    """CRC-32 of a file as MAVLink has it: zlib's polynomial, initial value 0, no final inversion.

    Source: PX4's `crc32part` and `generate_crc.py`, QGroundControl's `QGC::crc32`.
    """
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


class _Request(NamedTuple):
    """Request of a ground station."""

    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes
    """At most `size` bytes."""

    @classmethod
    def of(cls, message: Message) -> _Request:
        """The request in a FILE_TRANSFER_PROTOCOL."""
        payload = bytes(message.payload)
        sequence, session, opcode, size, _, _, _, offset = _HEADER.unpack_from(payload)
        data = payload[_HEADER.size : _HEADER.size + size]
        return cls(sequence, session, opcode, size, offset, data)

    @property
    def path(self) -> str:
        """File or directory without leading slashes; MAVSDK ends it with a NUL."""
        return self.data.split(b"\0", 1)[0].decode("ascii", errors="replace").lstrip("/")

    @property
    def data_bytes(self) -> int:
        """Number of bytes that a reply to a read may have; a size of 0 leaves it to the server."""
        return self.size or _MOST_DATA_BYTES


class _Reply(NamedTuple):
    """Reply to a request, or one packet of a burst. requested: opcode of the request."""

    sequence: int
    session: int
    opcode: Opcode
    requested: int
    offset: int
    data: bytes
    burst_complete: bool = False

    def message(self, receiver: Sender) -> Message:
        """FILE_TRANSFER_PROTOCOL to the sender of the request."""
        header = _HEADER.pack(
            self.sequence & 0xFFFF,
            self.session,
            self.opcode,
            len(self.data),
            self.requested,
            self.burst_complete,
            0,
            self.offset,
        )
        return create(
            "FILE_TRANSFER_PROTOCOL",
            target_network=0,
            target_system=receiver.system_id,
            target_component=receiver.component_id,
            payload=(header + self.data).ljust(_PAYLOAD_BYTES, b"\0"),
        )


def _ack(request: _Request, data: bytes = b"") -> _Reply:
    return _Reply(
        request.sequence + 1, request.session, Opcode.ACK, request.opcode, request.offset, data
    )


def _nak(request: _Request, error: FtpError) -> _Reply:
    return _ack(request)._replace(opcode=Opcode.NAK, data=bytes((error,)))


@dataclass(slots=True)
class _Burst:
    """Rest of a burst. packets: number of those sent."""

    request: _Request
    offset: int
    started_s: float
    packets: int = 0


class _Session:
    """A file that a ground station has opened, and what it reads of it."""

    __slots__ = ("burst", "closed", "closed_s", "name", "opened", "opened_s", "reads", "used_s")

    def __init__(self, request: _Request, now_s: float) -> None:
        self.closed: _Request | None = None
        """Request that has closed the file last."""
        self.closed_s = -math.inf
        self.reads: deque[_Request] = deque(maxlen=_MOST_READS)
        self.burst: _Burst | None = None
        self.used_s = now_s
        """Time of the last request or packet of a file."""
        self.open(request, now_s)

    def open(self, request: _Request, now_s: float) -> None:
        """Opens the file of a request, in place of the one that is open."""
        self.name: str | None = request.path
        """File that is open."""
        self.opened, self.opened_s = request, now_s
        self._end_reading()

    def close(self, request: _Request, now_s: float) -> None:
        """Closes the file."""
        self.name, self.closed, self.closed_s = None, request, now_s
        self._end_reading()

    def _end_reading(self) -> None:
        self.burst = None
        self.reads.clear()

    def is_late(self, request: _Request, now_s: float) -> bool:
        """Returns True for a request that was sent before the one that has opened the file."""
        if self.name is None or now_s - self.opened_s > _LATE_S:
            return False
        return 0 < (self.opened.sequence - request.sequence & 0xFFFF) < 0x8000

    def was_opened_by(self, request: _Request, now_s: float) -> bool:
        """Returns True for a copy of the request that has opened the file, which is closed.

        After RESET_SESSIONS, and later, it is of a client that has started again.
        """
        if self.closed is None or self.closed.opcode != Opcode.TERMINATE_SESSION:
            return False
        return request == self.opened and now_s - self.closed_s <= _DOUBLED_S

    def next_reply(self, file: bytes, most_bytes: int, now_s: float) -> _Reply | None:
        """Next packet of the open file with this content: of a read, then of a burst."""
        if self.reads:
            request = self.reads.popleft()
            size = min(request.data_bytes, most_bytes)
            return _ack(request, file[request.offset : request.offset + size])
        burst = self.burst
        if burst is None:
            return None
        asked_bytes = burst.request.data_bytes
        data = file[burst.offset : burst.offset + min(asked_bytes, most_bytes)]
        end = burst.offset + len(data)
        is_long = now_s - burst.started_s >= _BURST_S and len(data) == asked_bytes
        complete = end >= len(file) or is_long
        reply = _ack(burst.request, data)._replace(
            sequence=burst.request.sequence + 1 + burst.packets,
            offset=burst.offset,
            burst_complete=complete,
        )
        burst.offset, burst.packets = end, burst.packets + 1
        if complete:
            self.burst = None
        return reply


class _Key(NamedTuple):
    """A session of a ground station, by the number that it has given it."""

    sender: Sender
    number: int


class FileServer:
    """The files of the component, by their names, in one directory."""

    MESSAGE_IDS = frozenset({int(mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL)})
    """Messages that it reads."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = dict(sorted(files.items()))
        self._sessions: dict[_Key, _Session] = {}
        """Those that are open, and closed ones; the one that was served last stands at the end."""

    def handle(self, message: Message, asker: Asker, now_s: float) -> list[Message]:
        """Takes a request; returns its reply, unless that is a piece of a file.

        A request to all components is the autopilot's. A reply is never answered.
        """
        request = _Request.of(message)
        to_all = message.target_system == 0 or message.target_component == 0
        if to_all or request.opcode in {Opcode.ACK, Opcode.NAK}:
            return []
        self._forget_idle(now_s)
        reply = self._reply(request, _Key(asker.sender, request.session), now_s)
        return [] if reply is None else [reply.message(asker.sender)]

    def next_answer(self, link: str, most_bytes: int, now_s: float) -> Message | None:
        """Next packet of a file for a session on this link, each in turn; None: none is due.

        most_bytes: size of the largest packet.
        """
        data_bytes = min(max(most_bytes - _AROUND_DATA_BYTES, _LEAST_DATA_BYTES), _MOST_DATA_BYTES)
        for key, session in self._sessions.items():
            if key.sender.link != link or session.name is None:
                continue
            reply = session.next_reply(self._files[session.name], data_bytes, now_s)
            if reply is not None:
                session.used_s = now_s
                self._sessions[key] = self._sessions.pop(key)
                return reply.message(key.sender)
        return None

    def _reply(self, request: _Request, key: _Key, now_s: float) -> _Reply | None:
        if request.size > _MOST_DATA_BYTES:
            return _nak(request, FtpError.INVALID_DATA_SIZE)
        match request.opcode:
            case Opcode.NONE:
                return _ack(request)
            case Opcode.OPEN_FILE_RO:
                return self._open(request, key, now_s)
            case Opcode.TERMINATE_SESSION:
                return self._terminate(request, key, now_s)
            case Opcode.RESET_SESSIONS:
                return self._reset(request, key.sender, now_s)
            case Opcode.READ_FILE | Opcode.BURST_READ_FILE:
                return self._read(request, key, now_s)
            case Opcode.LIST_DIRECTORY:
                return self._list(request)
            case Opcode.CALC_FILE_CRC32:
                file = self._files.get(request.path)
                if file is None:
                    return _nak(request, FtpError.FILE_NOT_FOUND)
                return _ack(request, file_crc32(file).to_bytes(4, "little"))
        return _nak(
            request,
            FtpError.FILE_PROTECTED if request.opcode in _WRITES else FtpError.UNKNOWN_COMMAND,
        )

    def _open(self, request: _Request, key: _Key, now_s: float) -> _Reply | None:
        file = self._files.get(request.path)
        if file is None:
            return _nak(request, FtpError.FILE_NOT_FOUND)
        session = self._sessions.get(key)
        if session is None:
            if not self._has_room(key.sender):
                return _nak(request, FtpError.NO_SESSIONS_AVAILABLE)
            self._sessions[key] = _Session(request, now_s)
        elif session.is_late(request, now_s):
            if request.path != session.name:
                return None
        elif session.was_opened_by(request, now_s):
            return _ack(request, len(file).to_bytes(4, "little"))
        elif session.name is None or request != session.opened:
            session.open(request, now_s)
        self._sessions[key].used_s = now_s
        return _ack(request, len(file).to_bytes(4, "little"))

    def _terminate(self, request: _Request, key: _Key, now_s: float) -> _Reply:
        session = self._sessions.get(key)
        if session is None or (session.name is None and request != session.closed):
            return _nak(request, FtpError.INVALID_SESSION)
        if session.name is not None and not session.is_late(request, now_s):
            session.close(request, now_s)
        return _ack(request)

    def _reset(self, request: _Request, sender: Sender, now_s: float) -> _Reply:
        """Closes the files of a ground station, its own alone: others go on reading theirs."""
        for key, session in self._sessions.items():
            if key.sender == sender and not session.is_late(request, now_s):
                session.close(request, now_s)
        return _ack(request)

    def _read(self, request: _Request, key: _Key, now_s: float) -> _Reply | None:
        """Notes a read or a burst, whose replies wait for room; returns the reason if it cannot."""
        session = self._sessions.get(key)
        if session is None or session.name is None:
            return _nak(request, FtpError.INVALID_SESSION)
        session.used_s = now_s
        if request.offset >= len(self._files[session.name]):
            return _nak(request, FtpError.END_OF_FILE)
        if request.opcode == Opcode.READ_FILE:
            if len(session.reads) < _MOST_READS:
                session.reads.append(request)
            return None
        burst = session.burst
        doubled = burst is not None and burst.request == request
        if burst is None or not doubled or now_s - burst.started_s > _DOUBLED_S:
            session.burst = _Burst(request, request.offset, now_s)
        return None

    def _list(self, request: _Request) -> _Reply:
        """Entries from the index `offset` on, as many as fit into one packet."""
        if request.path not in {"", "."}:
            return _nak(request, FtpError.FILE_NOT_FOUND)
        entries = [f"F{name}\t{len(file)}\0".encode() for name, file in self._files.items()]
        data = b""
        for entry in entries[request.offset :]:
            if len(data) + len(entry) > _MOST_DATA_BYTES:
                break
            data += entry
        return _ack(request, data) if data else _nak(request, FtpError.END_OF_FILE)

    def _forget_idle(self, now_s: float) -> None:
        for key in [k for k, each in self._sessions.items() if now_s - each.used_s > _IDLE_S]:
            del self._sessions[key]

    def _has_room(self, sender: Sender) -> bool:
        """Makes room for one more session, in place of a closed one; False: there is none."""
        opened = [key for key, session in self._sessions.items() if session.name is not None]
        if sum(key.sender == sender for key in opened) >= _MOST_OF_SENDER:
            return False
        if len(self._sessions) < _MOST_SESSIONS:
            return True
        closed = next((key for key in self._sessions if key not in opened), None)
        if closed is not None:
            del self._sessions[closed]
        return closed is not None
