"""FTP requests and replies as bytes, apart from the server's own code."""

from __future__ import annotations

import struct
from typing import NamedTuple

from moar_companion.mavlink.commands import Sender
from moar_companion.mavlink.component.component_service import Asker
from moar_companion.mavlink.dialect import create

NONE, TERMINATE, RESET, LIST, OPEN, READ = range(6)
CRC32, BURST, ACK, NAK = 14, 15, 128, 129
LINK = "udp:0.0.0.0:14550"
HEADER = "<HBBBBBBI"


class Reply(NamedTuple):
    sequence: int
    session: int
    opcode: int
    size: int
    requested: int
    burst_complete: int
    padding: int
    offset: int
    data: bytes

    @property
    def error(self):
        """Error of a NAK; None of an ACK."""
        assert (self.opcode, self.size) in {(NAK, 1), (ACK, self.size)}
        return self.data[0] if self.opcode == NAK else None


def asker(system_id=255, component_id=190, link=LINK):
    sender = Sender(link=link, system_id=system_id, component_id=component_id)
    return Asker(sender=sender, objection=None, on_board=False)


def request(sequence, opcode, *, session=0, size=None, offset=0, data=b"", target=(1, 195)):
    """FILE_TRANSFER_PROTOCOL with a request."""
    header = struct.pack(
        HEADER, sequence, session, opcode, len(data) if size is None else size, 0, 0, 0, offset
    )
    return create(
        "FILE_TRANSFER_PROTOCOL",
        target_network=0,
        target_system=target[0],
        target_component=target[1],
        payload=(header + data).ljust(251, b"\0"),
    )


def reply_of(message):
    payload = bytes(message.payload)
    assert len(payload) == 251
    head = struct.unpack_from(HEADER, payload)
    return Reply(*head, payload[12 : 12 + head[3]])


class Client:
    """A ground station beside a server: requests in, replies out, with the next numbers."""

    def __init__(self, server, asked_by=None, now_s=100.0):
        self.server, self.asker, self.now_s = server, asked_by or asker(), now_s
        self.sequence = 0
        self.most_bytes = 280

    def ask(self, opcode, *, sequence=None, **fields):
        """Replies to a request, those that wait for room included."""
        self.sequence = self.sequence + 1 if sequence is None else sequence
        message = request(self.sequence, opcode, **fields)
        messages = self.server.handle(message, self.asker, self.now_s)
        for reply in messages:
            ids = self.asker.sender.system_id, self.asker.sender.component_id
            assert (reply.target_system, reply.target_component) == ids
        return [*map(reply_of, messages), *self.rest()]

    def rest(self):
        """Packets of files that wait for this client's link."""
        replies = []
        while message := self.server.next_answer(
            self.asker.sender.link, self.most_bytes, self.now_s
        ):
            replies.append(reply_of(message))
        return replies

    def one(self, opcode, **fields):
        (reply,) = self.ask(opcode, **fields)
        assert reply.sequence == self.sequence + 1
        assert reply.requested == opcode
        return reply

    def open(self, path=b"/parameter.json.xz", **fields):
        return self.one(OPEN, data=path, **fields)
