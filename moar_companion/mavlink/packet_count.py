"""Counts of one sender's packets on one link: received, lost, copies. No I/O.

The number in a header has 8 bits and repeats after 256 packets, which PX4 sends in 0.7 s. After a
gap the sender's own clock (`time_boot_ms`) and its packet rate before the gap give the number of
whole rounds: a rate that changes within the gap, by half a round or more, misleads it.
A packet without that time is placed by its number if that is the next or nearly so; any other one
waits for the next packet with a time. A sender that never reports its time is counted by the
numbers alone.
"""

from __future__ import annotations

from typing import NamedTuple

from .dialect import mavlink

BOOT_TIME_AT = {
    int(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME): 8,
    int(mavlink.MAVLINK_MSG_ID_ATTITUDE): 0,
    int(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED): 0,
    int(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT): 0,
}
"""Offset of `time_boot_ms` in the payload of the messages that both autopilots stamp when they
send. PX4 stamps others earlier: setpoints, and the readings of slow sensors."""

_ROUND = 256
_ROUND_MS = 1 << 32
"""Wraps of the number and of `time_boot_ms`."""
_NEXT = 32
"""Lead of a number that is taken without a time. A wrong one, of a copy that is late by most of a
round, counts as a loss until the true packets arrive: 0.1 s of PX4."""
_LATE = 80
"""Packets by which a late one may be behind. Delays of 50 to 200 ms shift a packet by 0.15 s, in
which PX4 sends 62 (412 a second)."""
_SEEN = 512
"""Latest numbers whose reception is remembered, so that a late packet counts once."""
_ALL_SEEN = (1 << _SEEN) - 1
_RECENT = 128
"""Latest packets by which byte-identical copies are recognised. Less than a round: packets without
a time, as HEARTBEAT, repeat byte by byte after it."""
_MOST_WAITING = 128
"""Packets that wait for one with a time; then the sender no longer reports it."""
_RATE_S = 1.0
"""Duration over which the packet rate is measured, by the sender's clock."""
_BACK_S = 1.0
_PAUSE_S = 10.0
"""Greatest steps of the clock back and forward: a link that reorders packets delivers them up to
1 s late. After a longer pause no packets count as lost: the sender was absent."""
_RESTARTED = 5
"""Successive stamps outside these limits after which the sender has another clock."""


class SourceStatistics(NamedTuple):
    """Packets of one source on one link, without copies.

    off_stream: received packets that belong to no stream that the companion reads.
    """

    received: int
    lost: int
    off_stream: int = 0


class _Mark(NamedTuple):
    """Number of a packet, counted without rounds, and the sender's time in it."""

    number: int
    boot_ms: int

    def passed_s(self, boot_ms: int) -> float:
        """Time from this packet to another time of the same clock; negative: before."""
        half = _ROUND_MS // 2
        return ((boot_ms - self.boot_ms + half) % _ROUND_MS - half) * 1e-3


class PacketCount:
    """Counts of one source."""

    __slots__ = (
        "_base",
        "_clock",
        "_foreign",
        "_newest",
        "_rate_hz",
        "_rate_since",
        "_recent",
        "_seen",
        "_waiting",
        "off_stream",
        "received",
    )

    def __init__(self) -> None:
        self.received = 0
        self.off_stream = 0
        self._newest = 0
        self._base = 0
        """Number before the first: `_newest - _base` packets were sent since."""
        self._seen = _ALL_SEEN
        """Bit n: the packet of the number `_newest - n` was received."""
        self._clock: _Mark | None = None
        """Newest packet with a time."""
        self._rate_since: _Mark | None = None
        self._rate_hz: float | None = None
        self._foreign = 0
        self._waiting: list[tuple[int, bool]] = []
        """Packets without a known place: sequence number, and True for one of no stream."""
        self._recent: dict[bytes, None] = {}

    @property
    def statistics(self) -> SourceStatistics:
        """Counts up to now."""
        lost = max(0, self._newest - self._base - self.received)
        return SourceStatistics(received=self.received, lost=lost, off_stream=self.off_stream)

    def is_copy(self, packet: bytes) -> bool:
        """Returns True for a packet that was received before, as a loop of routers repeats it.

        Only of a sender that reports its time: some radios give all packets the same number.
        """
        return packet in self._recent

    def count(self, packet: bytes, sequence: int, *, boot_ms: int | None, off_stream: bool) -> None:
        """Counts a packet; packets missing before it count as lost until they arrive late.

        boot_ms: the sender's time in it, if it has one.
        """
        if not self.received:
            self._newest = self._base = sequence - 1
        if boot_ms is not None:
            self._count_timed(sequence, boot_ms, off_stream)
        else:
            self._count_untimed(sequence, off_stream)
        if self._clock is not None:
            self._recent[packet] = None
            if len(self._recent) > _RECENT:
                del self._recent[next(iter(self._recent))]

    def _count_untimed(self, sequence: int, off_stream: bool) -> None:
        ahead = (sequence - self._newest) % _ROUND
        if self._clock is None:
            if sequence == 0 and _LATE < ahead < _ROUND - _LATE:
                self._restart(sequence)
            self._take(self._placed(sequence), off_stream)
        elif 0 < ahead <= _NEXT and not self._foreign:
            self._take(self._newest + ahead, off_stream)
        elif len(self._waiting) < _MOST_WAITING:
            self._waiting.append((sequence, off_stream))
        else:
            self._clock = None
            waiting, self._waiting = self._waiting, []
            for item in (*waiting, (sequence, off_stream)):
                self._count_untimed(*item)

    def _count_timed(self, sequence: int, boot_ms: int, off_stream: bool) -> None:
        clock = self._clock
        passed_s = 0.0 if clock is None else clock.passed_s(boot_ms)
        if not -_BACK_S <= passed_s <= _PAUSE_S:
            self._foreign += 1
            if self._foreign < _RESTARTED:
                return
            self._restart(sequence)
            clock = None
        self._foreign = 0
        if clock is None or self._rate_hz is None:
            number = self._placed(sequence)
        else:
            number = _nearest(clock.number + round(self._rate_hz * passed_s), sequence)
        self._take(number, off_stream)
        self._take_waiting(number)
        if clock is None or number > clock.number:
            self._note_clock(_Mark(number, boot_ms), restarted=clock is None)

    def _note_clock(self, newest: _Mark, *, restarted: bool) -> None:
        """Takes the newest packet with a time; measures the rate of the packets by it."""
        self._clock, since = newest, self._rate_since
        if restarted or since is None:
            self._rate_since, self._rate_hz = newest, None
        elif (elapsed_s := since.passed_s(newest.boot_ms)) >= _RATE_S:
            self._rate_since, self._rate_hz = newest, (newest.number - since.number) / elapsed_s

    def _restart(self, sequence: int) -> None:
        """Places the next packet after the newest one, whatever its number; counts no loss.

        Packets without a place count as received.
        """
        skipped = (sequence - self._newest - 1) % _ROUND
        placeless = len(self._waiting) + max(0, self._foreign - 1)
        self._newest += skipped
        self._base += skipped - placeless
        self.received += placeless
        self.off_stream += sum(off_stream for _, off_stream in self._waiting)
        self._waiting.clear()
        self._seen = _ALL_SEEN

    def _placed(self, sequence: int) -> int:
        """Number of a packet by its sequence number alone."""
        return _nearest(self._newest + _ROUND // 2 - _LATE, sequence)

    def _take_waiting(self, number: int) -> None:
        """Places the packets that wait, by the number of one that came after them."""
        for sequence, off_stream in self._waiting:
            self._take(_nearest(number + _LATE - _ROUND // 2, sequence), off_stream)
        self._waiting.clear()

    def _take(self, number: int, off_stream: bool) -> None:
        """Counts the packet of this number, unless it was received before, or is too late."""
        ahead = number - self._newest
        if ahead > 0:
            self._newest = number
            self._seen = self._seen << min(ahead, _SEEN) & _ALL_SEEN
        bit = 1 << max(0, -ahead)
        if bit & ~self._seen & _ALL_SEEN:
            self._seen |= bit
            self.received += 1
            self.off_stream += off_stream


def _nearest(expected: int, sequence: int) -> int:
    """Number with this sequence number, nearest to the expected one."""
    first = expected - _ROUND // 2
    return first + (sequence - first) % _ROUND
