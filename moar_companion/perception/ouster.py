"""Ouster data packets to scans, by ouster-sdk; all other packets are counted.

The SDK decodes the packets and computes the points. This module assembles the turns. The SDK's
batcher drops all packets of a sensor that restarted its turn numbers; it gives a turn only with the
fourth packet of the next. A turn is complete with its last missing column, or with the first
packet of another turn. Lost columns have no points.

A packet is ours if the SDK takes it: by its size and, where both have one, by the serial number.
The SDK reads no checksum; this module refuses a packet with a wrong one. Firmware before 2.5 has
a constant in that field.

Packets: Ouster Firmware User Manual, "Lidar Data Packet Format".
"""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt

from .lidar_scan import FloatArray, PacketFault, Scan

_NO_CHECKSUMS = (0, 0xDEADBEEF0000C0DE)
"""Constants in the checksum's field: of firmware up to 2.2, and of 2.3 and 2.4."""
_LONGEST_PACKET_NS = 1_000_000_000
"""Greatest time from the first column of a packet to the last."""
_CLOCK_STEP_S = 0.5
"""Least difference of two packets' delays that means a step of the sensor's clock."""


class OusterStream:
    """Packets of one sensor, in order of arrival.

    metadata: the sensor's description, the content of its .json. Raises ValueError if it is
    invalid.
    """

    def __init__(self, metadata: str) -> None:
        from ouster.sdk import core  # noqa: PLC0415 -- an extra

        try:
            info = core.SensorInfo(metadata)
            self._format = core.PacketFormat(info)
            self._to_points = core.XYZLut(info, use_extrinsics=False)
        except (RuntimeError, ValueError) as error:
            raise ValueError(f"is no description of an Ouster: {_one_line(error)}") from None
        self.packets = 0
        self.refused: Counter[PacketFault] = Counter()
        """Number of refused packets by reason."""
        self.port: int = info.config.udp_port_lidar or 0
        """UDP port to which the sensor sends data; 0 if the description lacks it."""
        self._headers = core.ColHeader
        self._serial = int(info.sn)
        self._typed = info.format.udp_profile_lidar != core.UDPProfileLidar.LEGACY
        self._columns = int(info.format.columns_per_frame)
        self._columns_used = int(info.format.valid_columns_per_frame())
        self._fields = [name for name in self._format.fields if name.startswith("RANGE")]
        if not self._fields:
            raise ValueError("describes an Ouster whose data packets are off")
        altitudes = np.asarray(info.beam_altitude_angles)
        self._rings = np.argsort(np.argsort(altitudes, kind="stable"))
        self._no_checksums = set(_NO_CHECKSUMS)
        self._wrong_checksum: int | None = None
        """Field of the last packet with a wrong checksum. A second packet with the same one shows
        that the field is a constant."""
        self._turn: _Turn | None = None
        self._finished: int | None = None
        """Number of the last turn that was given."""

    def receive(self, packet: bytes, now_s: float) -> Scan | None:
        """Takes a packet; returns the scan that it completes, if any."""
        fault = self._fault(packet)
        if fault is not None:
            self.refused[fault] += 1
            return None
        self.packets += 1
        content = np.frombuffer(packet, np.uint8)
        number = int(self._format.frame_id(content))
        if number == self._finished:
            return None
        done, turn = None, self._turn
        if turn is None or turn.number != number:
            done = self._scan(turn)
            turn = self._turn = self._begin(number)
        self._put(turn, content, now_s)
        if done is None and turn.seen.sum() >= self._columns_used:
            done, self._turn = self._scan(turn), None
        return done

    def finish(self) -> Scan | None:
        """The scan of the packets since the last one: a part of a turn; None without any."""
        done, self._turn = self._scan(self._turn), None
        return done

    def _fault(self, packet: bytes) -> PacketFault | None:
        size = int(self._format.lidar_packet_size)
        content = np.frombuffer(packet[:size].ljust(size, b"\0"), np.uint8)
        if len(packet) != size:
            begun = 0 < len(packet) < size and len(packet) != int(self._format.imu_packet_size)
            cut = begun and self._is_begun(content, len(packet))
            return PacketFault.CUT if cut else PacketFault.SIZE
        if not self._is_ours(content):
            return PacketFault.SENSOR
        if not self._checksum_holds(content):
            return PacketFault.CHECKSUM
        return None if self._is_sound(content) else PacketFault.ORDER

    def _is_begun(self, content: npt.NDArray[np.uint8], length: int) -> bool:
        """Returns True if the first bytes, of this number, begin a data packet of this sensor."""
        if self._typed:
            return int(self._format.prod_sn(content)) == self._serial
        whole = length // int(self._format.col_size)
        column = self._header("MEASUREMENT_ID", content)[:whole].astype(np.int64)
        stamped = self._header("TIMESTAMP", content)[:whole].all()
        return whole > 0 and bool(stamped and (column == column[0] + np.arange(whole)).all())

    def _is_ours(self, content: npt.NDArray[np.uint8]) -> bool:
        """Returns True unless packet and description have serial numbers that differ."""
        return int(self._format.prod_sn(content)) in {0, self._serial} or not self._serial

    def _checksum_holds(self, content: npt.NDArray[np.uint8]) -> bool:
        checksum = self._format.crc(content)  # None where the profile has none
        if checksum is None or checksum in self._no_checksums:
            return True
        if checksum == self._format.calculate_crc(content):
            return True
        if checksum == self._wrong_checksum:
            self._no_checksums.add(checksum)
            return True
        self._wrong_checksum = checksum
        return False

    def _is_sound(self, content: npt.NDArray[np.uint8]) -> bool:
        """Returns True if the columns in use are successive, in place and in time."""
        used = np.flatnonzero(self._header("STATUS", content) & 1)
        if not len(used):
            return True
        column = self._header("MEASUREMENT_ID", content)[used].astype(np.int64)
        stamp_ns = self._header("TIMESTAMP", content)[used].astype(np.int64)
        first = column[0] - used[0]
        return bool(
            first % int(self._format.columns_per_packet) == 0
            and 0 <= first <= self._columns - int(self._format.columns_per_packet)
            and np.array_equal(column, first + used)
            and (np.diff(stamp_ns) >= 0).all()
            and 0 <= stamp_ns[-1] - stamp_ns[0] <= _LONGEST_PACKET_NS
        )

    def _header(self, name: str, content: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        column = getattr(self._headers, name)
        return np.asarray(self._format.packet_header(column, content))

    def _begin(self, number: int) -> _Turn:
        return _Turn(number, len(self._fields), len(self._rings), self._columns)

    def _put(self, turn: _Turn, content: npt.NDArray[np.uint8], now_s: float) -> None:
        used = np.flatnonzero(self._header("STATUS", content) & 1)
        if not len(used):
            return
        column = self._header("MEASUREMENT_ID", content)[used]
        stamp_s = self._header("TIMESTAMP", content)[used] * 1e-9
        for ranges, name in zip(turn.range_mm, self._fields, strict=True):
            ranges[:, column] = self._format.packet_field(name, content)[:, used]
        turn.seen[column] = True
        turn.stamp_s[column] = stamp_s
        turn.delay_s[column] = now_s - stamp_s[-1]

    def _scan(self, turn: _Turn | None) -> Scan | None:
        """The points of a turn; None if no packet of it has arrived."""
        if turn is None:
            return None
        self._finished = turn.number
        delay_s = turn.delay_s
        if turn.seen.any() and np.ptp(delay_s[turn.seen]) < _CLOCK_STEP_S:
            # The packet with the least delay shows the difference of the two clocks best.
            delay_s = np.full_like(delay_s, delay_s[turn.seen].min())
        points: list[FloatArray] = []
        beams: list[tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]] = []
        for ranges in turn.range_mm:
            ring, column = np.nonzero(ranges)
            points.append(np.asarray(self._to_points(ranges))[ring, column])
            beams.append((ring, column))
        ring, column = np.concatenate(beams, axis=1)
        return Scan(
            points_m=np.concatenate(points),
            time_s=(turn.stamp_s + delay_s)[column],
            ring=self._rings[ring].astype(np.int64),
            beams=int(turn.seen.sum()) * len(self._rings),
        )


class _Turn:
    """Received columns of one turn. delay_s: the receiver's clock minus the sensor's."""

    __slots__ = ("delay_s", "number", "range_mm", "seen", "stamp_s")

    def __init__(self, number: int, returns: int, rows: int, columns: int) -> None:
        self.number = number
        self.range_mm = np.zeros((returns, rows, columns), np.uint32)
        self.seen = np.zeros(columns, bool)
        self.stamp_s = np.zeros(columns)
        self.delay_s = np.zeros(columns)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]
