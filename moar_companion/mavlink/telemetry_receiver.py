"""Identity and telemetry of the autopilot from the messages of all senders. No I/O.

The session uses one on its own links, `passive_listener` on a recording.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..settings.link_config import LinkRole
from . import translate, translate_obstacles
from .dialect import CURRENT_MODE_ID, Message, mavlink
from .identity import Autopilot, AutopilotConflict, AutopilotFound, AutopilotRestarted, Identity
from .packet_count import SourceStatistics
from .packet_order import PacketOrder
from .source_clock import Reading, SourceClock
from .telemetry import LinkStatistics, Telemetry
from .translate_radio import RADIO_IDS

MESSAGE_IDS = translate.MESSAGE_IDS | {
    int(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME),
    int(mavlink.MAVLINK_MSG_ID_TIMESYNC),
}
"""Messages that a listener reads."""

_CLOCK_TOLERANCE_S = 1.0
"""Tolerance of stamps: modules of an autopilot stamp their messages milliseconds apart, and a link
that reorders packets delivers them up to 1 s late."""
_BOOT_ROUND_S = 2**32 * 1e-3
"""Wrap of `time_boot_ms`: 32 bits, 49.7 days."""
_MOST_PACKETS = 4096
"""Packets by which copies of a slower route are recognised: 20 s at 200 a second."""
_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_OBSTACLES = frozenset(translate_obstacles.TRANSLATORS)
"""Messages that sensors on board send, too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeLeft:
    """The autopilot has left the mode that follows the companion's setpoints. mode: the new one."""

    mode: str


Shown = AutopilotFound | AutopilotRestarted | AutopilotConflict | ModeLeft
"""Event of the autopilot that a message reveals."""


class TelemetryReceiver:
    """Identifies the autopilot; keeps the telemetry of it, of sensors, radios, ground stations."""

    def __init__(self) -> None:
        self.identity = Identity()
        self.telemetry = Telemetry()
        self._boot_clock = SourceClock(round_s=_BOOT_ROUND_S, behind_s=_CLOCK_TOLERANCE_S)
        self._packets_read: dict[tuple[int, int, float], None] = {}
        """Message, sequence number and stamp of the last packets with the autopilot's clock."""
        self._order = PacketOrder(same={CURRENT_MODE_ID: _HEARTBEAT}, boot_clock=self._boot_clock)
        self._packet_s = 0.0
        self._components: dict[int, tuple[SourceClock, PacketOrder]] = {}
        """Clock and order of the packets of other components, by their id."""

    @property
    def autopilot(self) -> Autopilot | None:
        """Autopilot that was received first."""
        return self.identity.autopilot

    def is_autopilots(self, message: Message, link: str) -> bool:
        """Returns True for a message of the autopilot on its link."""
        autopilot = self.identity.autopilot
        source = (message.get_srcSystem(), message.get_srcComponent())
        return autopilot is not None and link == autopilot.link and source == autopilot.ids

    def handle(self, message: Message, *, link: str, role: LinkRole, now_s: float) -> Shown | None:
        """Takes a message of any sender on a link with this role; returns its autopilot event."""
        event: Shown | None = None
        message_id = message.get_msgId()
        if message_id == _HEARTBEAT:
            if translate.is_ground_station(message):
                self.telemetry = translate.update(self.telemetry, message, now_s)
            elif role is LinkRole.AUTOPILOT:
                event = self.identity.handle(message, link=link, now_s=now_s)
                if isinstance(event, AutopilotFound):
                    self._forget()
        if self.is_autopilots(message, link):
            event = event or self._read_clock(message, now_s)
            if isinstance(event, AutopilotRestarted):
                self._forget()
            before = self.telemetry.autopilot
            if not self._order.is_late(message, now_s):
                self._packet_s = self.identity.received_s = now_s
                self.telemetry = translate.update(self.telemetry, message, now_s)
            after = self.telemetry.autopilot
            if event is None and before and before.ours and after and not after.ours:
                event = ModeLeft(mode=after.mode)
        elif message_id in RADIO_IDS:
            # A telemetry radio has ids of its own, as system 51, component 68.
            self.telemetry = translate.update(self.telemetry, message, now_s)
        elif (
            message_id in _OBSTACLES
            and role is LinkRole.AUTOPILOT
            and self._is_on_board(message)
            and not self._is_late_of_component(message, now_s)
        ):
            self.telemetry = translate.update(self.telemetry, message, now_s)
        return event

    def _is_on_board(self, message: Message) -> bool:
        """Returns True for a message of another component of the autopilot's system."""
        autopilot = self.identity.autopilot
        if autopilot is None or message.get_srcSystem() != autopilot.system_id:
            return False
        return bool(message.get_srcComponent() != autopilot.component_id)

    def _is_late_of_component(self, message: Message, now_s: float) -> bool:
        """Returns True if a later packet of the same message and component was accepted before."""
        component = message.get_srcComponent()
        if component not in self._components:
            clock = SourceClock(round_s=_BOOT_ROUND_S)
            self._components[component] = clock, PacketOrder(same={}, boot_clock=clock)
        clock, order = self._components[component]
        boot_s = getattr(message, "time_boot_ms", None)
        if boot_s is not None and clock.read(boot_s * 1e-3, now_s) is Reading.RESTARTED:
            order.restart()
        return order.is_late(message, now_s)

    def _read_clock(
        self, message: Message, now_s: float
    ) -> AutopilotRestarted | AutopilotConflict | None:
        """Event from the autopilot's clock: its restart, or a second clock under its ids.

        A copy by a slower route reports nothing of the clock.
        """
        boot_s, autopilot = translate.boot_time_s(message), self.identity.autopilot
        if boot_s is None or autopilot is None:
            return None
        packet = message.get_msgId(), message.get_seq(), boot_s
        if packet in self._packets_read:
            return None
        self._packets_read[packet] = None
        if len(self._packets_read) > _MOST_PACKETS:
            del self._packets_read[next(iter(self._packets_read))]
        reading = self._boot_clock.read(boot_s, now_s)
        if reading is Reading.RESTARTED:
            return AutopilotRestarted(autopilot=autopilot)
        if reading is Reading.FOREIGN:
            return self.identity.note_other_clock(now_s)
        return None

    def note_order(self, system_id: int) -> None:
        """Takes the sender of an accepted order: its ground station is the operator's."""
        self.telemetry = translate.with_operator(self.telemetry, system_id)

    def count_packets(
        self,
        counted: SourceStatistics,
        round_trip_s: float | None = None,
        shortest_round_trip_s: float = 0.0,
    ) -> None:
        """Takes the counts of the autopilot's packets on its link, and the round-trip times."""
        statistics = LinkStatistics(
            received_s=self._packet_s,
            packets_received=counted.received,
            packets_lost=counted.lost,
            off_stream=counted.off_stream,
            packets_late=self._order.late,
            round_trip_s=round_trip_s,
            shortest_round_trip_s=shortest_round_trip_s,
        )
        self.telemetry = replace(self.telemetry, link=statistics)

    def _forget(self) -> None:
        """Drops the telemetry of the autopilot or its predecessor; the mode comes back at 1 Hz."""
        before = self.telemetry
        self._order.restart()
        self._boot_clock.reset()
        self.telemetry = Telemetry(
            autopilot=before.autopilot,
            radio=before.radio,
            radio_link=before.radio_link,
            radio_channels=before.radio_channels,
            ground_station=before.ground_station,
            ground_stations=before.ground_stations,
            operator_id=before.operator_id,
            link=before.link,
        )
