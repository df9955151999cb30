"""Commands about the messages of the companion, and what describes the component. No I/O.

MAV_CMD_REQUEST_MESSAGE, SET_MESSAGE_INTERVAL, GET_MESSAGE_INTERVAL, and the deprecated
REQUEST_PROTOCOL_VERSION and REQUEST_AUTOPILOT_CAPABILITIES; answers to TIMESYNC and PING.

Results: UNSUPPORTED for a message that is not published, DENIED for a number that is none, for an
interval that is fixed, and where a message is not sent on the link, TEMPORARILY_REJECTED while
nothing of it is known.
Source: https://mavlink.io/en/messages/common.html, and the services' pages there.
"""

from __future__ import annotations

import importlib.metadata
import re
from functools import cache

from ...types import AutopilotKind
from ..commands import CommandResult, MessageCommand
from ..dialect import Message, create, id_of, mavlink
from .published import Published, PublishedMessages, published

_TIMESYNC = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
_PING = int(mavlink.MAVLINK_MSG_ID_PING)
CLOCK_IDS = frozenset({_TIMESYNC, _PING})
"""Messages whose answers measure a round trip: sent at once."""

_ALL = (0, 0)
_MESSAGE_INTERVAL = int(mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL)
_GREATEST_ID = 0xFFFFFF
_GREATEST_INTERVAL_ID = 0xFFFF
"""MESSAGE_INTERVAL has 16 bits for the message's number, MAVLink 2 24."""
_OFF_US = -1
_UNAVAILABLE_US = 0
_LONGEST_US = 2**31 - 1
"""Longest interval that MESSAGE_INTERVAL can report, and so the longest that can be set: 35 min."""
_NUMBERED = {
    int(mavlink.MAV_CMD_REQUEST_PROTOCOL_VERSION): "PROTOCOL_VERSION",
    int(mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES): "AUTOPILOT_VERSION",
}
"""Commands that request one message, where param1 is 1."""

Result = tuple[CommandResult, list[Message]]
"""Result of a command, and the messages that follow it."""


def concerns_companion(command: MessageCommand) -> bool:
    """Returns True if the companion answers: to all components only if the message is its own."""
    message_id = _asked_id(command)
    row = None if message_id is None else published(message_id)
    return not command.to_all or (row is not None and row.asked_of_all)


def clock_answer(
    message: Message, *, ours: tuple[int, int], is_autopilots: bool, now_s: float
) -> Message | None:
    """Returns the answer to TIMESYNC or PING; None if none is due.

    ours: system and component id of the companion. Answered are TIMESYNC requests (tc1 = 0) to the
    companion, the autopilot's to all, and PING without a target.
    """
    source = {
        "target_system": message.get_srcSystem(),
        "target_component": message.get_srcComponent(),
    }
    target = (message.target_system, message.target_component)
    if message.get_msgId() == _PING:
        if target != _ALL:
            return None
        return create("PING", time_usec=message.time_usec, seq=message.seq, **source)
    if message.tc1 != 0 or not (target == ours or (target == _ALL and is_autopilots)):
        return None
    return create("TIMESYNC", tc1=max(1, int(now_s * 1e9)), ts1=message.ts1, **source)


def result_of(command: MessageCommand, messages: PublishedMessages, now_s: float) -> Result:
    """Carries out a command that concerns the companion."""
    message_id = _asked_id(command)
    if message_id is None:
        return CommandResult.DENIED, []
    if _asks_interval(command):
        return _interval(command, message_id, messages)
    row = published(message_id)
    if command.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
        return _set_interval(command, row, messages), []
    if row is None:
        return CommandResult.UNSUPPORTED, []
    answer = messages.requested(command.sender.link, row, now_s)
    if answer is None:
        return CommandResult.DENIED, []
    return (CommandResult.ACCEPTED if answer else CommandResult.TEMPORARILY_REJECTED), answer


def _asked_id(command: MessageCommand) -> int | None:
    """Number of the message that a command is about; None if it names none."""
    name = _NUMBERED.get(command.command)
    if name is not None:
        return id_of(name) if command.parameters[0] == 1 else None
    by_request = _asks_interval(command) and command.command == mavlink.MAV_CMD_REQUEST_MESSAGE
    return _whole(command.parameters[1 if by_request else 0], _GREATEST_ID)


def _asks_interval(command: MessageCommand) -> bool:
    """Returns True for GET_MESSAGE_INTERVAL, and for a request of MESSAGE_INTERVAL."""
    if command.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
        return command.parameters[0] == _MESSAGE_INTERVAL
    return command.command == int(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL)


def _interval(command: MessageCommand, message_id: int, messages: PublishedMessages) -> Result:
    """MESSAGE_INTERVAL of a message on the sender's link."""
    if message_id > _GREATEST_INTERVAL_ID:
        return CommandResult.DENIED, []
    row, interval_us = published(message_id), _UNAVAILABLE_US
    if row is not None:
        interval_s = messages.interval_s(command.sender.link, row.name)
        interval_us = _OFF_US if interval_s is None else round(interval_s * 1e6)
    answer = create("MESSAGE_INTERVAL", message_id=message_id, interval_us=interval_us)
    return CommandResult.ACCEPTED, [answer]


def _set_interval(
    command: MessageCommand, row: Published | None, messages: PublishedMessages
) -> CommandResult:
    """Sets the interval of a message on the sender's link."""
    interval_us = command.parameters[1]
    if row is None:
        return CommandResult.UNSUPPORTED
    if interval_us is None or not (0 <= interval_us <= _LONGEST_US or interval_us == _OFF_US):
        return CommandResult.DENIED
    interval_s = None if interval_us == _OFF_US else interval_us * 1e-6
    done = messages.set_interval(command.sender.link, row.name, interval_s)
    return CommandResult.ACCEPTED if done else CommandResult.DENIED


def _whole(value: float | None, greatest: int) -> int | None:
    """A parameter as a whole number from 0 on; None if it is none."""
    if value is None or not 0 <= value <= greatest:
        return None
    return int(value) if value == int(value) else None


# Description of the component


_CAPABILITIES = {
    "MISSION_REQUEST_INT": mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT,
    "FILE_TRANSFER_PROTOCOL": mavlink.MAV_PROTOCOL_CAPABILITY_FTP,
}
"""Capabilities by the message that a service of them reads."""
_PARAMETER_ENCODINGS = {
    "px4": mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
    "ardupilot": mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST,
}


def component_version(served: frozenset[int], kind: AutopilotKind | None) -> Message:
    """AUTOPILOT_VERSION of the component.

    served: messages that its services read. kind: of the autopilot, whose encoding of parameters
    the component has; None while unknown.
    """
    capabilities = mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    capabilities |= mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    for name, capability in _CAPABILITIES.items():
        capabilities |= capability if id_of(name) in served else 0
    if id_of("PARAM_REQUEST_LIST") in served and kind is not None:
        capabilities |= _PARAMETER_ENCODINGS.get(kind, 0)
    return create(
        "AUTOPILOT_VERSION",
        capabilities=capabilities,
        flight_sw_version=_version_number(),
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=[0] * 8,
        middleware_custom_version=[0] * 8,
        os_custom_version=[0] * 8,
        vendor_id=0,
        product_id=0,
        uid=0,
        uid2=[0] * 18,
    )


def protocol_version(_now_s: float) -> list[Message]:
    """PROTOCOL_VERSION: MAVLink 2 is sent, versions 1 and 2 are read; the hashes are unknown."""
    return [
        create(
            "PROTOCOL_VERSION",
            version=200,
            min_version=100,
            max_version=200,
            spec_version_hash=[0] * 8,
            library_version_hash=[0] * 8,
        )
    ]


@cache
def _version_number() -> int:
    """Version of the program: major, minor, patch in a byte each, then FIRMWARE_VERSION_TYPE."""
    try:
        words = importlib.metadata.version("moar-companion")
    except importlib.metadata.PackageNotFoundError:
        words = ""
    numbers = [min(int(number), 255) for number in re.findall(r"\d+", words)[:3]]
    major, minor, patch = (*numbers, 0, 0, 0)[:3]
    kind = int(mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL)
    return major << 24 | minor << 16 | patch << 8 | kind
