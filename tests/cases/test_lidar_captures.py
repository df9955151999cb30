"""Captures of lidars, with the points that the makers' decoders read."""

from __future__ import annotations

from pathlib import Path

import pytest

from moar_companion.commands.packet_captures import read_capture

pytest.importorskip("ouster.sdk.core", reason="needs the extra ouster")
pytest.importorskip("dpkt", reason="needs the extra lidar")
FOLDER = Path(__file__).parents[3] / "shared" / "cases"


@pytest.mark.recordings
@pytest.mark.skipif(not FOLDER.exists(), reason=f"no inputs that failed at {FOLDER}")
def test_an_ouster_with_firmware_2_4_is_read():
    capture = FOLDER / "ouster_fw23_placeholder_crc"
    points = read_capture(f"{capture}.pcap", f"{capture}.json", None)
    assert len(points) == 1779
