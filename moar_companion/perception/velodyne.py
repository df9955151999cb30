"""Velodyne data packets to scans, by velodyne-decoder; all other packets are counted.

Packets: VLP-16 User Manual 63-9243 Rev. E, section 9.3: 1,206 bytes, twelve blocks that begin with
0xFFEE, then time, return mode and model. A scan is one turn.
"""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import numpy.typing as npt

from .lidar_scan import Scan

PACKET_BYTES = 1206
_POSITION_BYTES = 512
"""Length of a packet with time and position of a GPS, on another port."""
_BLOCKS, _BLOCK_BYTES = 12, 100
_FLAG = b"\xff\xee"
_FULL_TURN = 36_000
_RETURN_MODES = (0x37, 0x38, 0x39)
_MODELS = {0x21: "HDL32E", 0x22: "VLP16", 0x24: "PuckHiRes", 0x28: "VLP32C"}
_DUAL_RETURN = 0x39
_PACKET_BEAMS = 384
"""Beams per packet; half as many where each beam has two returns."""
_HOUR_S = 3600.0


class VelodyneStream:
    """Packets of one sensor, in order of arrival."""

    def __init__(self) -> None:
        self.packets = 0
        self.refused = {"truncated": 0, "foreign": 0, "damaged": 0}
        """Number of refused packets: too short, of another kind, or damaged."""
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
        self._beams += _PACKET_BEAMS // 2 if packet[-2] == _DUAL_RETURN else _PACKET_BEAMS
        done = self._decoder.decode(now_s, packet)
        if done is None:
            return None
        beams, self._beams = self._beams, 0
        stamp, rows = done
        return _scan(stamp, rows, beams)

    def _fault(self, packet: bytes) -> str | None:
        if len(packet) != PACKET_BYTES:
            begun = packet.startswith(_FLAG) and len(packet) < PACKET_BYTES
            return "truncated" if begun and len(packet) != _POSITION_BYTES else "foreign"
        if packet[-1] not in _MODELS or packet[-2] not in _RETURN_MODES:
            return "foreign"
        for block in range(0, _BLOCKS * _BLOCK_BYTES, _BLOCK_BYTES):
            (azimuth,) = struct.unpack_from("<H", packet, block + 2)
            if packet[block : block + 2] != _FLAG or azimuth >= _FULL_TURN:
                return "damaged"
        return None


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
