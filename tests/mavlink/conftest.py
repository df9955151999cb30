"""Peers, and the recordings of real autopilots."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from .peer import Peer
from .story import Story

SHARED = Path(__file__).resolve().parents[3] / "shared"


@pytest.fixture
def story() -> Story:
    return Story()


@pytest.fixture
def peer() -> Callable[[int, int], Peer]:
    return Peer


@pytest.fixture
def autopilot() -> Peer:
    return Peer(1, 1)


@pytest.fixture
def ground_station() -> Peer:
    return Peer(255, 190)


def packets(path: Path) -> Iterator[tuple[float, bytes]]:
    """Time and packet of everything in a tlog."""
    data = path.read_bytes()
    position = 0
    while position + 8 < len(data):
        time_s = int.from_bytes(data[position : position + 8], "big") * 1e-6
        start = position + 8
        if data[start] == 0xFD:
            size = data[start + 1] + 12 + (13 if data[start + 2] & 1 else 0)
        else:
            size = data[start + 1] + 8
        yield time_s, data[start : start + size]
        position = start + size


@pytest.fixture
def recording() -> Callable[[str], list[tuple[float, bytes]]]:
    """Time and packet of everything in a recording, as named below `traces`."""

    def load(name: str) -> list[tuple[float, bytes]]:
        path = SHARED / "traces" / name
        if not path.exists():
            pytest.skip(f"the recording {path} is not here")
        return list(packets(path))

    return load
