"""MAVLink FTP: requests of ground stations to replies, on files that are in memory alone. No I/O.

Only the given files can be read, and nothing can be written. A path's leading slashes are left
out: QGroundControl asks for `//general.json.xz` when a URI has a slash after its component.

A ground station has one open file, session 0, and the next that it opens closes the one before.
PX4 has one session, too, and MAVSDK reads session 0 whatever number the server has given. A client
whose reply was lost repeats its request, MAVSDK with a new number, and a network doubles packets
and exchanges their order. Reading changes nothing, so that a repeat is answered again. A repeat of
what has opened or closed a file gets the reply of the first, and a request from before the open
file neither closes nor replaces it.

A burst ends after two seconds, since pymavlink gives up 3.7 s after its last request. It does not
end with a packet shorter than was asked for, which pymavlink takes for the end of the file.

Source: https://mavlink.io/en/services/ftp.html, and the clients in QGroundControl (FTPManager.cc),
MAVSDK (mavlink_ftp_client.cpp) and pymavlink (mavftp.py).
"""

from __future__ import annotations

import enum
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
"""Size of a piece that pymavlink and MAVProxy ask for. They take a shorter one as a file that has
changed, and end the download; so no link gets shorter pieces."""

_IDLE_S = 30.0
"""Time without a request after which an open file is closed: MAVSDK gives up after 10 s."""
_MOST_CLIENTS = 8
_MOST_READS = 8
"""Limit of the reads of a client that wait for room: pymavlink has five under way."""
_LATE_S = 5.0
"""Greatest delay of a request, or of its copy over another link."""
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
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes
    """At most `size` bytes."""

    @classmethod
    def of(cls, message: Message) -> _Request:
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
    sequence: int
    session: int
    opcode: Opcode
    requested: int
    offset: int
    data: bytes
    burst_complete: bool = False

    def message(self, receiver: Sender) -> Message:
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


def _ack(request: _Request, data: bytes = b"", *, session: int | None = None) -> _Reply:
    return _Reply(
        request.sequence + 1,
        request.session if session is None else session,
        Opcode.ACK,
        request.opcode,
        request.offset,
        data,
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


class _Client:
    """A ground station: the file that it has open, and what it reads of it."""

    __slots__ = ("_changed_s", "burst", "closed", "name", "opened", "reads", "used_s")

    def __init__(self, now_s: float) -> None:
        self.name: str | None = None
        """File that is open."""
        self.opened: _Request | None = None
        """Request that has opened the last file."""
        self.closed: _Request | None = None
        """Request that has closed a file last."""
        self.reads: deque[_Request] = deque(maxlen=_MOST_READS)
        self.burst: _Burst | None = None
        self.used_s = now_s
        """Time of the last request or packet of a file."""
        self._changed_s = now_s

    def open(self, request: _Request, now_s: float) -> None:
        """Opens the file of a request, in place of the one that is open."""
        self.name, self.opened = request.path, request
        self._end_reading(now_s)

    def close(self, request: _Request, now_s: float) -> None:
        """Closes the file that is open."""
        self.name, self.closed = None, request
        self._end_reading(now_s)

    def _end_reading(self, now_s: float) -> None:
        self.burst, self._changed_s = None, now_s
        self.reads.clear()

    def is_late(self, request: _Request, now_s: float) -> bool:
        """Returns True for a request that was sent before the one that has opened the open file."""
        if self.name is None or self.opened is None or now_s - self._changed_s > _LATE_S:
            return False
        return 0 < (self.opened.sequence - request.sequence & 0xFFFF) < 0x8000

    def is_repeated(self, request: _Request, now_s: float) -> bool:
        """Returns True for the request again that has closed a file last."""
        return request == self.closed and now_s - self._changed_s <= _LATE_S

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


class FileServer:
    """The files of the component, by their names, in one directory."""

    MESSAGE_IDS = frozenset({int(mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL)})
    """Messages that it reads."""

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = dict(sorted(files.items()))
        self._clients: dict[Sender, _Client] = {}
        """The one that was served last stands at the end."""

    def handle(self, message: Message, asker: Asker, now_s: float) -> list[Message]:
        """Takes a request; returns its reply, unless that is a piece of a file.

        A request to all components is the autopilot's. A reply is never answered.
        """
        request = _Request.of(message)
        to_all = message.target_system == 0 or message.target_component == 0
        if to_all or request.opcode in {Opcode.ACK, Opcode.NAK}:
            return []
        client = self._client_of(asker.sender, now_s)
        if client is not None:
            client.used_s = now_s
        reply = self._reply(request, asker.sender, client, now_s)
        return [] if reply is None else [reply.message(asker.sender)]

    def next_answer(self, link: str, most_bytes: int, now_s: float) -> Message | None:
        """Next packet of a file for a client on this link, each in turn; None: none is due.

        most_bytes: size of the largest packet.
        """
        data_bytes = min(max(most_bytes - _AROUND_DATA_BYTES, _LEAST_DATA_BYTES), _MOST_DATA_BYTES)
        for sender, client in self._clients.items():
            if sender.link != link or client.name is None:
                continue
            reply = client.next_reply(self._files[client.name], data_bytes, now_s)
            if reply is not None:
                client.used_s = now_s
                self._clients[sender] = self._clients.pop(sender)
                return reply.message(sender)
        return None

    def _reply(
        self, request: _Request, sender: Sender, client: _Client | None, now_s: float
    ) -> _Reply | None:
        if request.size > _MOST_DATA_BYTES:
            return _nak(request, FtpError.INVALID_DATA_SIZE)
        match request.opcode:
            case Opcode.NONE:
                return _ack(request)
            case Opcode.OPEN_FILE_RO:
                return self._open(request, sender, client, now_s)
            case Opcode.TERMINATE_SESSION | Opcode.RESET_SESSIONS:
                return _close(request, client, now_s)
            case Opcode.READ_FILE | Opcode.BURST_READ_FILE:
                return self._read(request, client, now_s)
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

    def _open(
        self, request: _Request, sender: Sender, client: _Client | None, now_s: float
    ) -> _Reply | None:
        file = self._files.get(request.path)
        if file is None:
            return _nak(request, FtpError.FILE_NOT_FOUND)
        if client is None:
            client = self._new_client(sender, now_s)
            if client is None:
                return _nak(request, FtpError.NO_SESSIONS_AVAILABLE)
        if client.is_late(request, now_s):
            return None
        if client.name is None or request != client.opened:
            client.open(request, now_s)
        return _ack(request, len(file).to_bytes(4, "little"), session=0)

    def _read(self, request: _Request, client: _Client | None, now_s: float) -> _Reply | None:
        """Notes a read or a burst, whose replies wait for room; returns the reason if it cannot."""
        if client is None or client.name is None or request.session != 0:
            return _nak(request, FtpError.INVALID_SESSION)
        if request.offset >= len(self._files[client.name]):
            return _nak(request, FtpError.END_OF_FILE)
        if request.opcode == Opcode.READ_FILE:
            if len(client.reads) < _MOST_READS:
                client.reads.append(request)
            return None
        burst = client.burst
        doubled = burst is not None and burst.request == request
        if burst is None or not doubled or now_s - burst.started_s > _DOUBLED_S:
            client.burst = _Burst(request, request.offset, now_s)
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

    def _client_of(self, sender: Sender, now_s: float) -> _Client | None:
        client = self._clients.get(sender)
        if client is not None and now_s - client.used_s > _IDLE_S:
            del self._clients[sender]
            return None
        return client

    def _new_client(self, sender: Sender, now_s: float) -> _Client | None:
        """A client in place of one that is idle or has no file open; None: all have one."""
        if len(self._clients) == _MOST_CLIENTS:
            free = (
                other
                for other, client in self._clients.items()
                if client.name is None or now_s - client.used_s > _IDLE_S
            )
            replaced = next(free, None)
            if replaced is None:
                return None
            del self._clients[replaced]
        client = self._clients[sender] = _Client(now_s)
        return client


def _close(request: _Request, client: _Client | None, now_s: float) -> _Reply:
    """Closes the client's file, its own alone: other ground stations go on reading theirs.

    A client resets its sessions when it starts, with any number: a reset counts even if it is late.
    """
    is_reset = request.opcode == Opcode.RESET_SESSIONS
    if client is None:
        return _ack(request) if is_reset else _nak(request, FtpError.INVALID_SESSION)
    is_repeated = client.is_repeated(request, now_s)
    if not is_repeated and not is_reset and (client.name is None or request.session != 0):
        return _nak(request, FtpError.INVALID_SESSION)
    if not is_repeated and (is_reset or not client.is_late(request, now_s)):
        client.close(request, now_s)
    return _ack(request)
