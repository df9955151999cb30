"""`moar-companion page`: the page without an aircraft, of a site or of a recorded flight."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import signal
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..settings.page_config import DEFAULT_HOST, DEFAULT_PORT
from .options import add_file, file_name, number, refused
from .outputs import print_text, report_compiling

if TYPE_CHECKING:
    from ..analysis.what_if import WhatIf
    from ..planner.site import Margin, Site
    from ..service.page.page_server import PageContent, Playback
    from ..settings.vehicle import Vehicle

_SITE_ENDINGS = {".yaml", ".yml"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the file, what it lacks, and the address."""
    parser.add_argument(
        "file",
        metavar="SITE|RECORDING",
        type=file_name("SITE|RECORDING"),
        help="a site file (.yaml), or a recording (.mcap; as `replay` has them also .tlog, .bin, "
        ".ulg)",
    )
    add_file(parser, "--vehicle", "the vehicle, but of an .mcap (default: the LineDrone as flown)")
    add_file(parser, "--site", "of a recording that is no .mcap: the site that was flown")
    parser.add_argument(
        "--host",
        metavar="ADDRESS",
        type=_host,
        default=DEFAULT_HOST,
        help=f"address of this computer (default: {DEFAULT_HOST}: only browsers on it)",
    )
    parser.add_argument(
        "--port",
        metavar="N",
        type=_port,
        default=DEFAULT_PORT,
        help=f"its TCP port (default: {DEFAULT_PORT})",
    )


def run(arguments: argparse.Namespace) -> int:
    """Serves the page until Ctrl-C, which is status 0."""
    from ..service.page_process import listen  # noqa: PLC0415

    report_compiling()
    content = _content(arguments)
    listener = listen(arguments.host, arguments.port)
    host, port = listener.getsockname()[:2]
    shown = f"[{host}]" if ":" in host else host
    print_text(f"page on http://{shown}:{port}/ (Ctrl-C ends it)\n")
    asyncio.run(_serve_until_signal(content, listener))
    return 0


async def _serve_until_signal(content: PageContent, listener: socket.socket) -> None:
    from ..service.page.page_server import serve  # noqa: PLC0415

    serving = asyncio.create_task(serve(content, listener))
    for end in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(end, serving.cancel)
    with contextlib.suppress(asyncio.CancelledError):
        await serving


def what_if_of(site_file: str, vehicle: Vehicle, margin: Margin) -> WhatIf:
    """What-if on a site file. Raises InputError for a file that cannot be used."""
    from ..analysis.what_if import WhatIf  # noqa: PLC0415
    from ..settings.yaml_file import text_of  # noqa: PLC0415

    return WhatIf(
        text=text_of(site_file),
        source=site_file,
        vehicle=vehicle,
        margin=margin,
        clock=time.perf_counter,
    )


def _content(arguments: argparse.Namespace) -> PageContent:
    """What the page of a file serves."""
    from ..settings.config import default_vehicle  # noqa: PLC0415
    from ..settings.vehicle import Vehicle  # noqa: PLC0415
    from .replay import begins_with  # noqa: PLC0415
    from .replay_mcap import MAGIC  # noqa: PLC0415

    file = arguments.file
    is_site = Path(file).suffix.lower() in _SITE_ENDINGS
    if is_site and arguments.site is not None:
        raise refused("--site", arguments.site, "must be left out: the page is of a site")
    if not is_site and begins_with(file, MAGIC):
        for name in ("site", "vehicle"):
            if getattr(arguments, name) is not None:
                allowed = "must be left out: an .mcap has its own"
                raise refused(f"--{name}", getattr(arguments, name), allowed)
        return _mcap_content(Path(file))
    vehicle = Vehicle.load(arguments.vehicle or default_vehicle())
    if is_site:
        return _site_content(file, vehicle)
    return _replay_content(Path(file), vehicle, arguments.site)


def _site_content(file: str, vehicle: Vehicle) -> PageContent:
    from ..companion.error_margin import margin_of  # noqa: PLC0415
    from ..planner.site import Site  # noqa: PLC0415
    from ..service.page.page_server import PageContent  # noqa: PLC0415
    from ..service.page_process import vehicle_view  # noqa: PLC0415
    from ..settings.config import Supervision  # noqa: PLC0415

    margin = margin_of(vehicle, Supervision())
    what_if = what_if_of(file, vehicle, margin)
    view = _view(Site.load(file).flown_with(margin), vehicle)
    return PageContent(
        about={"kind": "site", "recording": None, "vehicle": vehicle_view(vehicle)},
        site=lambda: view,
        make_what_if=lambda: what_if,
    )


def _mcap_content(file: Path) -> PageContent:
    from .playback import McapPlayback  # noqa: PLC0415

    playback = McapPlayback(file)
    return _recording_content(file, playback, playback.vehicle)


def _replay_content(file: Path, vehicle: Vehicle, site_file: str | None) -> PageContent:
    from .playback import ReplayPlayback  # noqa: PLC0415
    from .replay import played, site_position_of  # noqa: PLC0415

    position = view = None
    if site_file is not None:
        position = site_position_of(site_file, vehicle)
        view = _view(position.site, vehicle)
    replay = played(str(file), vehicle, position)
    return _recording_content(file, ReplayPlayback(replay, view), vehicle)


def _recording_content(file: Path, playback: Playback, vehicle: Vehicle | None) -> PageContent:
    from ..service.page.page_recordings import PageRecordings  # noqa: PLC0415
    from ..service.page.page_server import PageContent  # noqa: PLC0415
    from ..service.page_process import vehicle_view  # noqa: PLC0415

    about = {"kind": "recording", "recording": file.name}
    return PageContent(
        about={**about, "vehicle": None if vehicle is None else vehicle_view(vehicle)},
        site=playback.site,
        recordings=PageRecordings(file=file),
        open_playback=lambda _: playback,
    )


def _view(site: Site, vehicle: Vehicle) -> dict[str, Any]:
    """Site and maps, as `GET /api/site` has them."""
    from ..planner.maps import build_maps  # noqa: PLC0415
    from ..planner.site_view import maps_view, site_view  # noqa: PLC0415

    maps = maps_view(build_maps(site, vehicle))
    return {"revision": 1, "site": site_view(site), "maps": maps}


def _host(text: str) -> str:
    import ipaddress  # noqa: PLC0415

    try:
        ipaddress.ip_address(text)
    except ValueError:
        allowed = "must be an address of this computer, as 127.0.0.1, 0.0.0.0 or ::"
        raise refused("--host", text, allowed) from None
    return text


def _port(text: str) -> int:
    value = number(text)
    if value is None or not value.is_integer() or not 1 <= value <= 65_535:
        raise refused("--port", text, "must be a port, 1 to 65535")
    return int(value)
