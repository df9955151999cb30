"""Search for the autopilot: serial ports at their usual rates, UDP ports of simulators.

Each port is opened at one rate after the other, and all ports at once, until heartbeats of an
autopilot arrive. Sockets and files; the machine behind is `mavlink/autopilot_reader`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..errors import LinkError
from ..mavlink.autopilot_reader import AutopilotReader
from ..mavlink.identity import Autopilot
from ..mavlink.link import open_link
from ..mavlink.link_basics import clock_s
from ..mavlink.peers import Address
from ..mavlink.urls import parse_url

BAUD_RATES = (921_600, 57_600, 115_200, 460_800, 230_400, 500_000, 1_000_000, 1_500_000)
"""Usual rates, the most frequent first: PX4's TELEM2 has 921600 by default, ArduPilot's SERIAL2
57600, USB any."""
UDP_LINKS = ("udp::14540", "udp::14550")
"""PX4's port for companions, and that of ground stations, to which routers send, too."""
_LISTEN_S = 2.2
"""Two heartbeats."""
_PERIOD_S = 0.05
_BY_ID = Path("/dev/serial/by-id")
_BUILT_IN = (
    "moar-*",
    "ttyTHS*",
    "ttyAMA*",
    "ttyAML*",
    "ttymxc*",
    "serial[0-9]",
    "ttyACM*",
    "ttyUSB*",
)
"""Names of ports in /dev: those of `systemd/serial.rules`, UARTs of companion computers, and USB
where udev makes no names."""
_DEV = Path("/dev")


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """An autopilot on a link."""

    url: str
    autopilot: Autopilot


def serial_ports() -> list[str]:
    """Devices of serial ports: by the names that last where udev makes them, each port once."""
    paths = [*sorted(_BY_ID.glob("*"))]
    paths += [path for pattern in _BUILT_IN for path in sorted(_DEV.glob(pattern))]
    named: dict[Path, str] = {}
    for path in paths:
        named.setdefault(path.resolve(), str(path))
    return list(named.values())


def urls_of(device: str) -> list[str]:
    """URLs of a serial port at all usual rates."""
    return [f"serial:{device}:{rate}" for rate in BAUD_RATES]


async def search(
    ports: Sequence[Sequence[str]], report: Callable[[str], None]
) -> tuple[list[Found], dict[str, str]]:
    """Autopilots on ports, each given by its URLs; and by URL why others have none.

    report: is called with each URL on which it begins to listen.
    """
    found: list[Found] = []
    silent: dict[str, str] = {}

    async def listen(urls: Sequence[str]) -> None:
        for url in urls:
            report(url)
            try:
                async with opened([url]) as reader:
                    await until(lambda: reader.autopilot is not None, _LISTEN_S)
                    autopilot, count = reader.autopilot, reader.received_bytes
            except LinkError as error:
                silent[url] = str(error)
                return
            if autopilot is not None:
                found.append(Found(url=url, autopilot=autopilot))
                return
            silent[url] = f"{count} bytes, no heartbeat" if count else "nothing is received"

    await asyncio.gather(*(listen(urls) for urls in ports))
    return found, silent


async def until(condition: Callable[[], bool], timeout_s: float = math.inf) -> bool:
    """Waits for a condition; False if it did not come true in time."""
    end_s = clock_s() + timeout_s
    while True:
        if condition():
            return True
        if clock_s() >= end_s:
            return False
        await asyncio.sleep(_PERIOD_S)


@contextlib.asynccontextmanager
async def opened(urls: Iterable[str]) -> AsyncIterator[AutopilotReader]:
    """A reader on open links, whose bytes are carried and whose cycles are run until the end."""
    urls = list(urls)
    reader = AutopilotReader(urls)

    def receive(url: str, data: bytes, arrived_s: float, address: Address | None) -> None:
        reader.receive(url, data, arrived_s, address)

    async with contextlib.AsyncExitStack() as stack:
        logging.getLogger("moar_companion.mavlink.link").setLevel(logging.ERROR)
        links = {
            url: await stack.enter_async_context(open_link(parse_url(url), partial(receive, url)))
            for url in urls
        }

        async def run_loop() -> None:
            while True:
                reader.tick(clock_s())
                for url, data in reader.data_to_send():
                    links[url].send(data, math.inf, reader.peers(url))
                await asyncio.sleep(_PERIOD_S)

        running = asyncio.create_task(run_loop(), name="autopilot reader")
        try:
            yield reader
        finally:
            running.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await running
