"""The planned path as a mission that a ground station downloads from the component. No I/O.

In: the path (`offer`), requests of the mission protocol. Out: MISSION_COUNT, MISSION_ITEM_INT,
MISSION_ACK. Without a path the list is empty. It is read only: an upload, a clear, and a change of
the current item are refused with MISSION_ACK and a text.

A path changes in flight, so a download is of the path at its first request, until it ends: a
ground station that repeats a request never gets a mixture of two. Only what carries exactly the
component's address is answered: a request to all components means the autopilot's mission, and
QGroundControl takes answers of any component for the autopilot's (PlanManager.cc).

A sender with the vehicle's system id gets no answer. An autopilot takes a MISSION_COUNT to its own
system for an upload, and clears its mission: PX4 one to component 0, 1 or 190, ArduPilot one to any
component that it has no route to.

Source: https://mavlink.io/en/services/mission.html (MISSION_REQUEST is answered with
MISSION_ITEM_INT, as it requires).
"""

from __future__ import annotations

import binascii
import math
import struct
from dataclasses import dataclass

from ...texts import pilot_texts
from ...types import GeodeticPoint
from ..commands import Sender
from ..dialect import Message, create, id_of, mavlink
from ..rate_limits import SenderLimit
from .component_service import Asker

_LIST, _ACK = id_of("MISSION_REQUEST_LIST"), id_of("MISSION_ACK")
_REQUESTS = frozenset({id_of("MISSION_REQUEST"), id_of("MISSION_REQUEST_INT")})
_UPLOADS = frozenset(
    map(
        id_of,
        (
            "MISSION_COUNT",
            "MISSION_CLEAR_ALL",
            "MISSION_SET_CURRENT",
            "MISSION_WRITE_PARTIAL_LIST",
        ),
    )
)
"""Messages that would change a mission; the first of an upload is refused, so no item follows."""

_MISSION = int(mavlink.MAV_MISSION_TYPE_MISSION)
_TIMEOUT_S = 10.0
"""Silence after which a download has ended: ground stations repeat a request within 2 s."""
_LATE_S = 2.0
"""Time in which a second request of the list, before the first item or after the last one, may be a
copy of the first: then it is answered with the same path."""
_MOST_DOWNLOADS = 8
"""Limit of downloads at a time; beyond it the one silent longest ends."""
_DEGREES = 1e7
"""MAVLink's integers for one degree."""
_OPAQUE_SEED = 1
"""Checksum of an empty path: 0 would mean that the id is not supported."""

Path = tuple[GeodeticPoint, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionRefused:
    """A mission that was sent to the component. reason: a text for operators."""

    reason: str
    sender: Sender


@dataclass(slots=True)
class _Download:
    """A download: its path, and the time of its last request."""

    path: Path
    asked_s: float
    between: bool = False
    """True after the request of an item that is not the last."""

    def is_under_way(self, now_s: float) -> bool:
        """Returns True if a request of the list belongs to this download."""
        silent_s = _TIMEOUT_S if self.between else _LATE_S
        return bool(self.path) and now_s - self.asked_s <= silent_s


class PathMission:
    """Serves the path to any number of ground stations."""

    MESSAGE_IDS = frozenset({_LIST, _ACK}) | _REQUESTS | _UPLOADS

    def __init__(self) -> None:
        self._path: Path = ()
        self._downloads: dict[Sender, _Download] = {}
        """By ground station, the one silent longest first."""
        self._texts = SenderLimit(burst=1, rate_hz=0.5, link_burst=5, link_rate_hz=1.0)
        self._events: list[MissionRefused] = []

    def offer(self, path: Path) -> None:
        """Takes the planned path, its corners in order; empty without one."""
        self._path = path

    def events_received(self) -> list[MissionRefused]:
        """Returns the events since the last call."""
        events, self._events = self._events, []
        return events

    def handle(self, message: Message, asker: Asker, now_s: float) -> list[Message]:
        """Takes a message of the mission protocol; returns its answer."""
        sender, message_id = asker.sender, message.get_msgId()
        if message.target_component == 0 or _may_be_autopilot(asker):
            return []
        if message_id == _ACK:
            self._downloads.pop(sender, None)
            return []
        if message_id in _UPLOADS:
            return [self._refusal(message, sender, now_s)]
        if message.mission_type != _MISSION:
            unsupported = mavlink.MAV_MISSION_UNSUPPORTED
            return [_acknowledgement(sender, unsupported, message.mission_type)]
        if message_id == _LIST:
            return [_count(sender, self._begun(sender, now_s).path)]
        return [self._item(message, sender, now_s)]

    def _begun(self, sender: Sender, now_s: float) -> _Download:
        """The download of a ground station that requests the list."""
        download = self._downloads.pop(sender, None)
        if download is None or not download.is_under_way(now_s):
            download = _Download(path=self._path, asked_s=now_s)
        if len(self._downloads) >= _MOST_DOWNLOADS:
            del self._downloads[next(iter(self._downloads))]
        self._downloads[sender] = download
        return download

    def _item(self, message: Message, sender: Sender, now_s: float) -> Message:
        """MISSION_ITEM_INT; where none is under way the ground station has to begin again."""
        download = self._downloads.get(sender)
        if (
            download is None
            or now_s - download.asked_s > _TIMEOUT_S
            or message.seq >= len(download.path)
        ):
            return _acknowledgement(sender, mavlink.MAV_MISSION_INVALID_SEQUENCE)
        self._downloads[sender] = self._downloads.pop(sender)
        download.asked_s = now_s
        download.between = message.seq < len(download.path) - 1
        return _waypoint(sender, message.seq, download.path[message.seq])

    def _refusal(self, message: Message, sender: Sender, now_s: float) -> Message:
        """MISSION_ACK that denies a change; its text is limited by sender and by link."""
        if self._texts.allows(sender, now_s):
            reason = pilot_texts.FOR_AUTOPILOT(kind="mission", detail="the path is read only")
            self._events.append(MissionRefused(reason=reason, sender=sender))
        mission_type = getattr(message, "mission_type", _MISSION)
        return _acknowledgement(sender, mavlink.MAV_MISSION_DENIED, mission_type)


def _may_be_autopilot(asker: Asker) -> bool:
    """Returns True if an autopilot may take an answer to this sender for its own."""
    sender = asker.sender
    is_autopilots = sender.component_id == mavlink.MAV_COMP_ID_AUTOPILOT1
    return asker.on_board or sender.system_id == 0 or is_autopilots


def _acknowledgement(sender: Sender, result: int, mission_type: int = _MISSION) -> Message:
    return create(
        "MISSION_ACK",
        target_system=sender.system_id,
        target_component=sender.component_id,
        type=result,
        mission_type=mission_type,
    )


def _count(sender: Sender, path: Path) -> Message:
    return create(
        "MISSION_COUNT",
        target_system=sender.system_id,
        target_component=sender.component_id,
        count=len(path),
        mission_type=_MISSION,
        opaque_id=_opaque_id(path),
    )


def _waypoint(sender: Sender, number: int, point: GeodeticPoint) -> Message:
    """MAV_CMD_NAV_WAYPOINT at an altitude above mean sea level; the heading is left open."""
    return create(
        "MISSION_ITEM_INT",
        target_system=sender.system_id,
        target_component=sender.component_id,
        seq=number,
        frame=mavlink.MAV_FRAME_GLOBAL,
        command=mavlink.MAV_CMD_NAV_WAYPOINT,
        current=int(number == 0),
        autocontinue=1,
        param1=0.0,
        param2=0.0,
        param3=0.0,
        param4=math.nan,
        x=round(point.latitude_deg * _DEGREES),
        y=round(point.longitude_deg * _DEGREES),
        z=point.altitude_amsl_m,
        mission_type=_MISSION,
    )


def _opaque_id(path: Path) -> int:
    """Number by which a ground station recognises the path that it has."""
    checksum = _OPAQUE_SEED
    for point in path:
        values = (point.latitude_deg, point.longitude_deg, point.altitude_amsl_m)
        checksum = binascii.crc32(struct.pack("<3d", *values), checksum)
    return checksum or _OPAQUE_SEED
