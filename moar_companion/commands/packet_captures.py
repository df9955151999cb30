"""Packet captures of lidars (.pcap, .pcapng): UDP packets with their times, points of all turns."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..settings.input_file import open_file, unreadable
from ..settings.perception_config import DATA_PORTS, Sensor
from .options import require

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from ..perception.lidar_scan import Scan
    from ..perception.ouster import OusterStream
    from ..perception.velodyne import VelodyneStream

_MOST_IN_FRAGMENTS = 64
"""Maximum number of datagrams with kept fragments; beyond it the oldest is dropped."""
_DLT_RAW_IP = 101
"""Link type of raw IP in files; dpkt has the number of the BSDs."""


def read_capture(file: str, metadata: str | None, port: int | None) -> npt.NDArray[np.float64]:
    """The points of a capture, in the sensor's axes; raises InputError.

    metadata: the description of an Ouster; without one the sensor is a Velodyne. port: of the data
    packets; None: the one that the description names, or the sensor's usual one.
    """
    stream, sensor = _stream(file, metadata)
    if port is None:
        port = getattr(stream, "port", 0) or DATA_PORTS[sensor]
    ports: Counter[int] = Counter()
    turns: list[Scan | None] = []
    from ..perception.lidar_scan import refusals  # noqa: PLC0415

    for time_s, arrived_at, payload in udp_packets(file):
        ports[arrived_at] += 1
        if arrived_at == port:
            turns.append(stream.receive(payload, time_s))
    if stream.packets == 0:
        hint = "" if metadata else "; an Ouster's need --metadata FILE.json, others --port N"
        if ports[port]:
            problem = f"{ports[port]} packets at UDP port {port}, {refusals(stream.refused)}"
        else:
            others = ", ".join(f"{count} at {each}" for each, count in sorted(ports.items()))
            name = {Sensor.VELODYNE: "a Velodyne", Sensor.OUSTER: "an Ouster"}[sensor]
            problem = f"no data packets of {name} at UDP port {port}"
            hint = f"; its UDP packets: {others or 'none'}{hint}"
        raise InputError(file, "", f"has {problem}{hint}")
    turns.append(stream.finish())
    import numpy as np  # noqa: PLC0415

    return np.concatenate([turn.points_m for turn in turns if turn is not None])


def data_packets(file: str, port: int) -> Iterator[tuple[float, bytes]]:
    """Time in seconds and payload of each UDP packet to a port; raises InputError."""
    return ((time_s, payload) for time_s, to, payload in udp_packets(file) if to == port)


def udp_packets(file: str) -> Iterator[tuple[float, int, bytes]]:
    """Time in seconds, destination port and payload of each UDP packet; raises InputError.

    Datagrams in fragments, as an Ouster's on Ethernet, are assembled. A capture that was cut off
    ends with its last packet.
    """
    require(file, "dpkt", "lidar")
    import dpkt  # noqa: PLC0415

    links = {
        dpkt.pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        dpkt.pcap.DLT_LINUX_SLL: dpkt.sll.SLL,
        dpkt.pcap.DLT_LINUX_SLL2: dpkt.sll2.SLL2,
        dpkt.pcap.DLT_NULL: dpkt.loopback.Loopback,
        dpkt.pcap.DLT_RAW: dpkt.ip.IP,
        _DLT_RAW_IP: dpkt.ip.IP,
    }
    fragments = _Fragments()
    broken = (ValueError, KeyError, IndexError, struct.error, dpkt.dpkt.Error)
    with Path(file).open("rb") as content:
        try:
            reader = dpkt.pcap.UniversalReader(content)
            link = links[reader.datalink()]
        except broken:
            raise InputError(file, "", "cannot be read as a packet capture") from None
        frames = iter(reader)
        while True:
            try:
                time_s, frame = next(frames)
            except (StopIteration, *broken):
                return
            try:
                datagram = fragments.datagram(link(frame))
            except broken:
                continue
            if datagram is not None:
                yield float(time_s), int(datagram.dport), bytes(datagram.data)


class _Fragments:
    """Puts the fragments of IPv4 datagrams together."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[bytes, bytes, int], dict[int, Any]] = {}

    def datagram(self, packet: Any) -> Any:
        """The UDP datagram in a frame, or that its fragment completes; None without one."""
        import dpkt  # noqa: PLC0415

        while isinstance(packet, dpkt.dpkt.Packet) and not isinstance(packet, dpkt.udp.UDP):
            if isinstance(packet, dpkt.ip.IP) and (packet.mf or packet.offset):
                whole = self._put(packet) if packet.p == dpkt.ip.IP_PROTO_UDP else None
                return None if whole is None else dpkt.udp.UDP(whole)
            packet = packet.data
        return packet if isinstance(packet, dpkt.udp.UDP) else None

    def _put(self, packet: Any) -> bytes | None:
        key = packet.src, packet.dst, packet.id
        parts = self._waiting.setdefault(key, {})
        parts[8 * packet.offset] = packet
        whole = b""
        for start in sorted(parts):
            if start != len(whole):
                break
            whole += bytes(parts[start].data)
            if not parts[start].mf:
                del self._waiting[key]
                return whole
        if len(self._waiting) > _MOST_IN_FRAGMENTS:
            del self._waiting[next(iter(self._waiting))]
        return None


def _stream(file: str, metadata: str | None) -> tuple[OusterStream | VelodyneStream, Sensor]:
    if metadata is None:
        require(file, "velodyne_decoder", "lidar")
        from ..perception.velodyne import VelodyneStream  # noqa: PLC0415

        return VelodyneStream(), Sensor.VELODYNE
    require(file, "ouster.sdk", "ouster")
    from ..perception.ouster import OusterStream  # noqa: PLC0415

    try:
        with open_file(metadata) as description:
            return OusterStream(description.read().decode()), Sensor.OUSTER
    except OSError as error:
        raise InputError(metadata, "", unreadable(error)) from None
    except UnicodeDecodeError:
        raise InputError(metadata, "", "is no text") from None
    except ValueError as error:
        raise InputError(metadata, "", str(error)) from None
