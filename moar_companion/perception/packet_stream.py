"""Decoder of a sensor's data packets, by the kind of the sensor."""

from __future__ import annotations

from typing import Protocol

from ..perception_config import Perception, Sensor
from .lidar_scan import Scan
from .ouster import OusterStream
from .velodyne import VelodyneStream


class PacketStream(Protocol):
    """Packets of one sensor, in order of arrival."""

    packets: int
    refused: dict[str, int]
    """Number of packets that were left out, by reason."""

    def receive(self, packet: bytes, now_s: float) -> Scan | None:
        """Takes a packet; returns the scan that it completes, if any."""


def packet_stream(settings: Perception, description: str) -> PacketStream | None:
    """Stream of the configured sensor; None if the sensor sends no packets of its own.

    description: content of the sensor's metadata file.
    """
    if settings.sensor is Sensor.VELODYNE:
        return VelodyneStream()
    if settings.sensor is Sensor.OUSTER:
        return OusterStream(description)
    return None
