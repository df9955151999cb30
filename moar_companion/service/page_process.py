"""The service's end of the page: starts its process, sends it what it shows, and takes its orders.

The control loop never waits for the process: a status that the process does not take in time is
dropped. Without a viewer a status a second suffices, for the flown path.
"""

from __future__ import annotations

import contextlib
import json
import logging
import socket
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..companion.error_margin import margin_of
from ..companion.planning.site_maps import SiteMaps
from ..errors import LinkError
from ..mavlink.commands import ORDERS, CommandResult
from ..mavlink.link_basics import clock_s, reason
from ..planner.site_view import maps_view, site_view
from ..settings.config import CompanionConfig
from ..settings.page_config import PageConfig
from ..settings.vehicle import Vehicle
from .child_process import ChildProcess
from .directories import recorder_folder
from .order_queue import OrderQueue
from .secret_file import LONGEST_BYTES, UnusableSecretError, secret_place

_WORKER = "moar_companion.commands.page_worker"
"""Module of the process, above the service: it has the planner and the readers of recordings."""
_PERIOD_S = 0.08
"""Period of statuses for viewers: 12 a second."""
_UNWATCHED_PERIOD_S = 1.0
_SITE_PERIOD_S = 1.0
"""Least time between two sites: a sensor changes the maps several times a second."""
_MOST_CELLS = 40_000
"""Cells of the maps that are sent: more than a display shows."""
_RECEIVED_BYTES = 4096
"""Of the process, a cycle: dozens of orders. Its faults must not take the cycle's time."""
_GREATEST_INDEX = 65_535
_SHORTEST_TOKEN, _LONGEST_TOKEN = 16, 256
_BACKLOG = 64

_logger = logging.getLogger(__name__)

StatusNow = Callable[[], dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSetup:
    """Input of the process at its start. Files and folders are absolute.

    about: the vehicle, for people. token: of orders; None: there are none. margin_m: of the
    position, of the tracking. recordings: their folder.
    """

    allowed_hosts: tuple[str, ...]
    tile_url: str | None
    about: dict[str, Any]
    token: str | None
    vehicle: str
    site: str | None
    margin_m: tuple[float, float]
    recordings: str | None


def vehicle_view(vehicle: Vehicle) -> dict[str, Any]:
    """A vehicle as the page shows it."""
    return {
        "name": vehicle.name,
        "radius_m": vehicle.radius_m,
        "d_min_m": vehicle.safety.d_min_m,
        "d_max_m": vehicle.safety.d_max_m,
        "reserve_s": vehicle.power.reserve_s,
        "endurance_s": vehicle.risk.endurance_s,
    }


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens for browsers. Raises LinkError if it cannot be opened."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(_BACKLOG)
    except OSError as error:
        listener.close()
        raise LinkError(f"page on {host}:{port}: {reason(error)}") from error
    listener.setblocking(False)
    return listener


def read_token(settings: PageConfig, source: str) -> str | None:
    """The token of orders; None if the page gives none. Raises InputError."""
    if not settings.takes_orders:
        return None
    place = secret_place(
        source,
        "page.",
        ("token_file", settings.token_file),
        ("token_credential", settings.token_credential),
    )
    try:
        return _token_in(place.content())
    except (OSError, UnusableSecretError) as error:
        raise place.refused(error) from error


def _token_in(content: bytes) -> str:
    token = content.strip()
    printable = all(0x21 <= byte <= 0x7E for byte in token)
    if not printable or not _SHORTEST_TOKEN <= len(token) <= _LONGEST_TOKEN:
        size = len(token) if len(content) <= LONGEST_BYTES else f"over {LONGEST_BYTES}"
        raise UnusableSecretError(
            f"holds no token ({size} bytes), must be {_SHORTEST_TOKEN} to {_LONGEST_TOKEN} "
            "printable characters without spaces"
        )
    return token.decode()


class PageProcess:
    """The page's process. orders: link of the control loop; None if the page gives none.

    Raises InputError for a token that cannot be used, LinkError for a port that cannot be opened.
    """

    def __init__(self, config: CompanionConfig, vehicle: Vehicle) -> None:
        settings = config.page
        token = read_token(settings, str(config.file or "page"))
        folder, margin = recorder_folder(config), margin_of(vehicle, config.supervision)
        setup = PageSetup(
            allowed_hosts=settings.allowed_hosts,
            tile_url=settings.tile_url,
            about=vehicle_view(vehicle),
            token=token,
            vehicle=str(Path(config.vehicle).absolute()),
            site=None if config.site is None else str(Path(config.site).absolute()),
            margin_m=(margin.position_m, margin.tracking_m),
            recordings=None if folder is None else str(folder.path.absolute()),
        )
        self.orders = None if token is None else OrderQueue(config.component_id)
        self._listener = listen(settings.host, settings.port)
        # The other end stays open here, too: a restart loses no orders.
        self._channel, self._other_end = socket.socketpair()
        self._channel.setblocking(False)
        self._unsent = b""
        self._received = b""
        self._watched = False
        self._due_s = self._site_due_s = 0.0
        self._site: SiteMaps | None = None
        """The site that the process has."""
        self._revision = 0
        self._failed = False
        self._process = ChildProcess(
            "page",
            _WORKER,
            [self._listener.fileno(), self._other_end.fileno()],
            json.dumps(asdict(setup)).encode(),
        )
        _logger.info("page on http://%s:%d", *self._listener.getsockname()[:2])

    @property
    def process_id(self) -> int | None:
        """Process id; None while no process runs."""
        return self._process.process_id

    def exchange(self, status_now: StatusNow, site_maps: SiteMaps | None) -> None:
        """Takes orders, sends answers, and what is due: once a cycle, with little work."""
        if self._failed:
            return
        try:
            self._receive()
            self._send_answers()
            self._send_due(clock_s(), status_now, site_maps)
        except Exception as error:  # noqa: BLE001 - a fault of the page must not end a flight
            self._failed = True
            _logger.error("the page ended: %s: %s", type(error).__name__, error)  # noqa: TRY400

    def close(self) -> None:
        """Ends the process."""
        self._process.close(self._other_end, self._channel, self._listener)

    def _send_due(self, now_s: float, status_now: StatusNow, site_maps: SiteMaps | None) -> None:
        if not self._flush():
            return
        if site_maps is not None and site_maps is not self._site and now_s >= self._site_due_s:
            self._site, self._site_due_s = site_maps, now_s + _SITE_PERIOD_S
            self._revision += 1
            maps = maps_view(site_maps.maps, most_cells=_MOST_CELLS)
            view = {"site": site_view(site_maps.site), "maps": maps}
            self._send({"site": {"revision": self._revision, **view}})
        elif now_s >= self._due_s:
            period_s = _PERIOD_S if self._watched else _UNWATCHED_PERIOD_S
            # By deadlines that do not drift; after a stall nothing is sent twice.
            self._due_s = max(self._due_s + period_s, now_s)
            self._send({"status": status_now()})

    def _send_answers(self) -> None:
        if self.orders is None:
            return
        for answer in self.orders.answers():
            self._answer(answer.order_id, answer.result, answer.reason)

    def _answer(self, order_id: str, result: CommandResult, reason: str) -> None:
        final = result is not CommandResult.IN_PROGRESS
        values = {"result": result.name, "final": final, "reason": reason}
        self._send({"answer": {"order_id": order_id, **values}})

    def _receive(self) -> None:
        """Takes what the process sent since the last call."""
        with contextlib.suppress(BlockingIOError):
            self._received += self._channel.recv(_RECEIVED_BYTES)
        *lines, rest = self._received.split(b"\n")
        self._received = rest[-_RECEIVED_BYTES:]
        for line in lines:
            # Before the first line after a restart there may be a part of one.
            with contextlib.suppress(json.JSONDecodeError):
                self._take(json.loads(line))

    def _take(self, message: dict[str, Any]) -> None:
        match message:
            case {"watched": watched}:
                self._watched, self._due_s = watched, 0.0
            case {"site_wanted": _}:
                self._site, self._watched = None, False
            case {
                "order": {
                    "order_id": str(order_id),
                    "word": str(word),
                    "target": (int() | None) as target,
                }
            } if (
                self.orders is not None and word in ORDERS and 0 <= (target or 0) <= _GREATEST_INDEX
            ):
                if not self.orders.give(order_id, word, target):
                    reason = "too many orders at once"
                    self._answer(order_id, CommandResult.TEMPORARILY_REJECTED, reason)

    def _send(self, message: dict[str, Any]) -> None:
        self._unsent += json.dumps(message, allow_nan=False).encode() + b"\n"
        self._flush()

    def _flush(self) -> bool:
        """Sends what the process has not taken; True if nothing is left."""
        while self._unsent:
            try:
                self._unsent = self._unsent[self._channel.send(self._unsent) :]
            except BlockingIOError:
                return False
        return True
