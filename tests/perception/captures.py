"""Real packet captures of lidars, beside the checkout."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest

from moar_companion.commands.packet_captures import data_packets

FOLDER = Path(__file__).parents[3] / "shared" / "data" / "lidar_packets"
OUSTERS = ("OS-0-32-U1_v2.2.0_1024x10", "OS-1-32-G_v2.1.1_1024x10")
OUSTER_PORT = 7502
recorded = [
    pytest.mark.recordings,
    pytest.mark.skipif(not FOLDER.exists(), reason=f"no packet captures at {FOLDER}"),
]


def metadata(name):
    return (FOLDER / f"{name}.json").read_text()


@cache
def packets(name):
    """Time in seconds and content of an Ouster's data packets: one turn."""
    return tuple(data_packets(str(FOLDER / f"{name}.pcap"), OUSTER_PORT))
