"""Process of the page that the service starts: `python -m … LISTENER CHANNEL`, two descriptors.

Its setup comes as JSON on standard input. It ends when the service closes its end of the channel.
The planner and the readers of recordings are imported when they are first asked for.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..service.page.page_channel import ServiceChannel
from ..service.page.page_recordings import PageRecordings
from ..service.page.page_server import PageContent, Playback, WhatIfPlans, serve

_logger = logging.getLogger(__name__)


def content_of(setup: Mapping[str, Any], channel: ServiceChannel) -> PageContent:
    """What the page of a service serves. setup: a `page_process.PageSetup` as JSON."""
    site, recordings = setup["site"], setup["recordings"]
    return PageContent(
        about={"kind": "service", "recording": None, "vehicle": setup["about"]},
        site=lambda: channel.site,
        feed=channel.feed,
        order=channel.order,
        token=setup["token"],
        recordings=PageRecordings(None if recordings is None else Path(recordings)),
        open_playback=_playback,
        make_what_if=None if site is None else lambda: _what_if(setup),
        allowed_hosts=frozenset(setup["allowed_hosts"]),
        tile_url=setup["tile_url"],
    )


def _what_if(setup: Mapping[str, Any]) -> WhatIfPlans:
    """Of the site and the vehicle as their files have them, with the margin of the flight.

    The compiler's memory is released again: with it the process would have half as much more.
    """
    from ..planner.site import Margin  # noqa: PLC0415
    from ..service.resident_memory import release_compiler  # noqa: PLC0415
    from ..settings.vehicle import Vehicle  # noqa: PLC0415
    from .page import what_if_of  # noqa: PLC0415

    position_m, tracking_m = setup["margin_m"]
    margin = Margin(position_m=position_m, tracking_m=tracking_m)
    plans = what_if_of(setup["site"], Vehicle.load(setup["vehicle"]), margin)
    release_compiler()
    return plans


def _playback(path: Path) -> Playback:
    from .playback import McapPlayback  # noqa: PLC0415

    return McapPlayback(path)


async def _run(setup: Mapping[str, Any], listener: socket.socket, channel: socket.socket) -> None:
    service = ServiceChannel(channel)
    reading = asyncio.create_task(service.run())
    serving = asyncio.create_task(serve(content_of(setup, service), listener))
    done, waiting = await asyncio.wait({reading, serving}, return_when=asyncio.FIRST_COMPLETED)
    for task in waiting:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
    for task in done:
        task.result()


def main(arguments: list[str]) -> int:
    """Runs until the service ends; returns the exit status."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    listener, channel = (socket.socket(fileno=int(number)) for number in arguments)
    for item in (listener, channel):
        item.setblocking(False)
    try:
        asyncio.run(_run(json.load(sys.stdin), listener, channel))
    except KeyboardInterrupt:
        return 0
    except Exception as error:  # noqa: BLE001 - the service starts it again
        _logger.error("page: %s: %s", type(error).__name__, error)  # noqa: TRY400
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
