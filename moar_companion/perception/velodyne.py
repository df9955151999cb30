"""Velodyne data packets to scans, by velodyne-decoder; all other packets are counted.

Packets: VLP-16 User Manual 63-9243 Rev. E, section 9.3: 1,206 bytes, twelve blocks that begin with
0xFFEE, then time, return mode and model. A scan is one turn. An HDL-32E with firmware before 2.2.20
sends no return mode. An Alpha Prime marks the blocks of its four groups of lasers, and leaves the
last four blocks empty where each beam has two returns.
"""

from __future__ import annotations

import struct
from collections import Counter
from typing import Any

import numpy as np
import numpy.typing as npt

from .lidar_scan import PacketFault, Scan

PACKET_BYTES = 1206
_POSITION_BYTES = 512
"""Length of a packet with time and position of a GPS, on another port."""
_BLOCKS, _BLOCK_BYTES = 12, 100
_BEAMS = 32
"""Beams per block; two blocks have the same beams where each has two returns."""
_MARKS = (b"\xff\xee", b"\xff\xdd", b"\xff\xcc", b"\xff\xbb")
_FULL_TURN = 36_000
_STRONGEST, _DUAL_RETURN = 0x37, 0x39
_RETURN_MODES = (_STRONGEST, 0x38, _DUAL_RETURN)
_ALPHA_PRIME = 0xA1
_MODELS = {
    0x21: "HDL32E",
    0x22: "VLP16",
    0x24: "PuckHiRes",
    0x28: "VLP32C",
    _ALPHA_PRIME: "VLS128",
}
_HOUR_S = 3600.0


class VelodyneStream:
    """Packets of one sensor, in order of arrival."""

    def __init__(self) -> None:
        self.packets = 0
        self.refused: Counter[PacketFault] = Counter()
        """Number of refused packets by reason."""
        self._decoder: Any = None
        self._model: int | None = None
        self._beams = 0

    def receive(self, packet: bytes, now_s: float) -> Scan | None:
        """Takes a packet; returns the scan that it completes, if any."""
        fault = self._fault(packet)
        if fault is not None:
            self.refused[fault] += 1
            return None
        self.packets += 1
        if packet[-1] != self._model:
            self._model = packet[-1]
            self._decoder = _decoder(packet[-1])
        if packet[-2] not in _RETURN_MODES:
            packet = packet[:-2] + bytes((_STRONGEST, packet[-1]))
        per_beam = 2 if packet[-2] == _DUAL_RETURN else 1
        self._beams += _used_blocks(packet) * _BEAMS // per_beam
        return self._taken(self._decoder.decode(now_s, packet))

    def finish(self) -> Scan | None:
        """The scan of the packets since the last one: a part of a turn; None without any."""
        return None if self._decoder is None else self._taken(self._decoder.finish())

    def _taken(self, done: Any) -> Scan | None:
        if done is None:
            return None
        beams, self._beams = self._beams, 0
        stamp, rows = done
        return _scan(stamp, rows, beams)

    def _fault(self, packet: bytes) -> PacketFault | None:
        if len(packet) != PACKET_BYTES:
            begun = packet.startswith(_MARKS[0]) and len(packet) < PACKET_BYTES
            cut = begun and len(packet) != _POSITION_BYTES
            return PacketFault.CUT if cut else PacketFault.SIZE
        if packet[-1] not in _MODELS:
            return PacketFault.MODEL
        marks = _MARKS if packet[-1] == _ALPHA_PRIME else _MARKS[:1]
        for block in range(0, _used_blocks(packet) * _BLOCK_BYTES, _BLOCK_BYTES):
            (azimuth,) = struct.unpack_from("<H", packet, block + 2)
            if packet[block : block + 2] not in marks or azimuth > _FULL_TURN:
                return PacketFault.MARKS
        return None


def _used_blocks(packet: bytes) -> int:
    return 8 if (packet[-2], packet[-1]) == (_DUAL_RETURN, _ALPHA_PRIME) else _BLOCKS


def _decoder(model: int) -> Any:
    import velodyne_decoder  # noqa: PLC0415 -- an extra

    config = velodyne_decoder.Config(model=getattr(velodyne_decoder.Model, _MODELS[model]))
    return velodyne_decoder.StreamDecoder(config)


def _scan(stamp: Any, rows: npt.NDArray[np.float32], beams: int) -> Scan:
    """The scan of rows: x, y, z, intensity, time, column, ring, return type.

    Times are relative to the stamp; the sensor's clock restarts each hour.
    """
    offset_s = (rows[:, 4].astype(float) + _HOUR_S / 2.0) % _HOUR_S - _HOUR_S / 2.0
    return Scan(
        points_m=rows[:, :3].astype(float),
        time_s=stamp.host + offset_s,
        ring=rows[:, 6].astype(np.int64),
        beams=beams,
    )
