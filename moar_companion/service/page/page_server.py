"""The page's server: its addresses, and what each answers.

    GET    /, /static/NAME          the page
    GET    /api/page                what this page can do
    GET    /api/site                site and maps (`planner/site_view`), with a revision
    WS     /live                    frames of the live state (`live_state`)
    POST   /api/order               {order, target}, with the token; the companion's answer
    GET    /api/recordings          recorded flights; /NAME/FILE one of its files
    DELETE /api/recordings/NAME     removes a flight, with the token
    GET    /api/playback/NAME       its time line; /frames?from=S&to=S, /site
    GET    /api/what-if             what can be changed; POST a change, and have the new plan

A refusal is {"problem": one line}. Every request is checked by `request_checks` first.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import math
import socket
from collections.abc import Awaitable, Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from ...errors import InputError
from .browser_connection import BrowserConnection
from .live_feed import LiveFeed
from .live_state import json_text
from .newest_work import NewestWork, SupersededError
from .page_channel import ServiceAnswer
from .page_recordings import PageRecordings
from .request_checks import has_token
from .request_guard import RequestGuard
from .static_files import StaticFiles

MOST_VIEWERS = 32
_SEND_S = 10.0
"""A viewer that takes no frame for this time is closed."""
_LONGEST_BODY = 256 * 1024
_BODY_S = 10.0
_PAUSE_S = 1.0
"""After a wrong token; one at a time."""
_PING_S = 10.0
_LONGEST_FRAME = 1024
"""Of a viewer, in bytes: viewers send none."""
_LONGEST_HEADERS = 16 * 1024
_WORDS = frozenset({"hold", "inspection", "exit", "evacuation", "release", "pause", "continue"})
_TRY_LATER, _NO_MESSAGES = 1013, 1008
"""Codes of RFC 6455."""

_logger = logging.getLogger(__name__)


class Playback(Protocol):
    """A recording as time line and frames; called in one thread."""

    def summary(self) -> dict[str, Any]:
        """Length, events, flown path."""

    def frames(self, from_s: float, to_s: float) -> list[dict[str, Any]]:
        """Frames from one time to another, in seconds since its begin."""

    def site(self) -> dict[str, Any] | None:
        """Site and maps; None without any."""


class WhatIfPlans(Protocol):
    """Plans of a changed site; called in one thread."""

    def document(self) -> dict[str, Any]:
        """What a request may change, as it is."""

    def answer(self, document: Mapping[str, Any]) -> dict[str, Any]:
        """The answer; raises InputError for a request that cannot be understood."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageContent:
    """What a page serves.

    about: `GET /api/page`. site: of now, None while there is none. feed, order: of a service.
    token: of what acts; None: nothing acts. open_playback: of a recording's file, by its path.
    """

    about: Mapping[str, Any]
    site: Callable[[], dict[str, Any] | None]
    feed: LiveFeed | None = None
    order: Callable[[str, int | None], Awaitable[ServiceAnswer | None]] | None = None
    token: str | None = None
    recordings: PageRecordings = field(default_factory=PageRecordings)
    open_playback: Callable[[Path], Playback] | None = None
    make_what_if: Callable[[], WhatIfPlans] | None = None
    allowed_hosts: frozenset[str] = frozenset()
    tile_url: str | None = None


async def serve(content: PageContent, listener: socket.socket) -> None:
    """Serves until it is cancelled."""
    config = uvicorn.Config(
        _application(content),
        http=BrowserConnection,
        ws="websockets-sansio",
        ws_max_size=_LONGEST_FRAME,
        ws_per_message_deflate=False,
        ws_ping_interval=_PING_S,
        ws_ping_timeout=_PING_S,
        h11_max_incomplete_event_size=_LONGEST_HEADERS,
        proxy_headers=False,
        server_header=False,
        lifespan="off",
        access_log=False,
        log_config=None,
        timeout_graceful_shutdown=1,
    )
    logging.getLogger("uvicorn").setLevel(logging.CRITICAL)
    server = _Server(config)
    serving = asyncio.create_task(server.serve(sockets=[listener]))
    try:
        await asyncio.shield(serving)
    finally:
        server.should_exit = True
        await serving


class _Server(uvicorn.Server):
    """Signals are the program's own."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Captures none."""
        yield


def _application(content: PageContent) -> RequestGuard:
    page = _Page(content)
    routes = [
        Route("/", page.index),
        Route("/static/{name}", page.static),
        Route("/api/page", page.about),
        Route("/api/site", page.site),
        WebSocketRoute("/live", page.live),
        Route("/api/order", page.order, methods=["POST"]),
        Route("/api/recordings", page.recordings),
        Route("/api/recordings/{name}", page.remove, methods=["DELETE"]),
        Route("/api/recordings/{name}/{file}", page.download),
        Route("/api/playback/{name}", page.playback),
        Route("/api/playback/{name}/frames", page.playback_frames),
        Route("/api/playback/{name}/site", page.playback_site),
        Route("/api/what-if", page.what_if, methods=["GET", "POST"]),
    ]
    handlers = {_RefusedError: _refused, InputError: _not_understood, 404: _not_found}
    application = Starlette(routes=routes, exception_handlers=handlers)
    return RequestGuard(application, content.allowed_hosts, content.tile_url)


class _RefusedError(Exception):
    """A request that is not answered as asked: status of HTTP, and the reason."""

    def __init__(self, status: int, problem: str) -> None:
        super().__init__(problem)
        self.status = status


async def _refused(_request: Any, error: Any) -> Response:
    return _json({"problem": str(error)}, error.status)


async def _not_understood(_request: Any, error: Any) -> Response:
    return _json({"problem": str(error)}, 400)


async def _not_found(_request: Any, _error: Any) -> Response:
    return _json({"problem": "is not served here"}, 404)


def _json(value: Any, status: int = 200) -> Response:
    return Response(json_text(value), status, media_type="application/json")


class _Page:
    """Answers to requests."""

    def __init__(self, content: PageContent) -> None:
        self._content = content
        self._files = StaticFiles()
        self._wrong_token = asyncio.Lock()
        # The planner and a recording's reader are each for one thread.
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="page")
        self._newest = NewestWork(self._thread)
        self._what_if: WhatIfPlans | None = None
        self._playback: tuple[Path, Playback] | None = None

    async def index(self, request: Request) -> Response:
        return self._file(request, "index.html")

    async def static(self, request: Request) -> Response:
        return self._file(request, request.path_params["name"])

    def _file(self, request: Request, name: str) -> Response:
        file = self._files.file(name)
        if file is None:
            raise _RefusedError(404, "is not served here")
        headers = {"ETag": file.tag}
        if request.headers.get("if-none-match") == file.tag:
            return Response(status_code=304, headers=headers)
        return Response(file.content, media_type=file.media_type, headers=headers)

    async def about(self, _request: Request) -> Response:
        content = self._content
        orders = content.order is not None and content.token is not None
        plans = content.make_what_if is not None
        values = {"orders": orders, "what_if": plans, "tile_url": content.tile_url}
        return _json({**content.about, **values})

    async def site(self, _request: Request) -> Response:
        return _json(self._content.site())

    async def live(self, websocket: WebSocket) -> None:
        feed = self._content.feed
        if feed is None:
            await websocket.close()
            return
        await websocket.accept()
        if feed.viewers >= MOST_VIEWERS:
            await websocket.close(_TRY_LATER, f"more than {MOST_VIEWERS} viewers")
            return
        sending = asyncio.create_task(_send_frames(websocket, feed))
        receiving = asyncio.create_task(websocket.receive())
        try:
            await asyncio.wait({sending, receiving}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (sending, receiving):
                task.cancel()
            await asyncio.gather(sending, receiving, return_exceptions=True)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await websocket.close(_NO_MESSAGES)

    async def order(self, request: Request) -> Response:
        give = self._content.order
        if give is None or self._content.token is None:
            raise _RefusedError(403, "this page gives no orders")
        await self._check_token(request)
        word, target = self._understood(await _document(request))
        answer = await give(word, target)
        if answer is None:
            raise _RefusedError(503, "the companion does not answer")
        values = {"result": answer.result, "final": answer.final, "reason": answer.reason}
        return _json(values)

    def _understood(self, document: dict[str, Any]) -> tuple[str, int | None]:
        """Word and index of an order."""
        word, target = document.get("order"), document.get("target")
        if not isinstance(word, str) or word not in _WORDS:
            raise _RefusedError(400, f"order must be one of {', '.join(sorted(_WORDS))}")
        if isinstance(target, str):
            site = (self._content.site() or {}).get("site", {})
            names = [item["name"] for item in site.get("targets", ())]
            if target not in names:
                raise _RefusedError(400, f"target must be one of {', '.join(names) or 'none'}")
            target = names.index(target)
        is_index = isinstance(target, int) and not isinstance(target, bool)
        if target is not None and not (is_index and 0 <= target <= 65_535):
            raise _RefusedError(400, "target must be a name, an index from 0 on, or null")
        return word, target

    async def _check_token(self, request: Request) -> None:
        token = self._content.token
        if token is None:
            raise _RefusedError(403, "this page changes nothing")
        if has_token(request.headers.get("authorization"), token):
            return
        async with self._wrong_token:
            await asyncio.sleep(_PAUSE_S)
        raise _RefusedError(401, "the token is wrong")

    async def recordings(self, _request: Request) -> Response:
        flights = await asyncio.to_thread(self._content.recordings.flights, self._active)
        return _json({"recordings": flights})

    async def download(self, request: Request) -> Response:
        path = self._recording(request.path_params["name"], request.path_params["file"])
        return _FileAsItWas(
            path, filename=f"{path.parent.name}_{path.name}", media_type="application/octet-stream"
        )

    async def remove(self, request: Request) -> Response:
        await self._check_token(request)
        name, feed = request.path_params["name"], self._content.feed
        if feed is not None and not feed.begun:
            raise _RefusedError(503, "the present flight is unknown until the next status")
        if name == self._active:
            raise _RefusedError(409, "this flight is being recorded")
        if not await asyncio.to_thread(self._content.recordings.remove, name):
            raise _RefusedError(404, "no such recording")
        return _json({"removed": name})

    @property
    def _active(self) -> str | None:
        """Name of the recording that is being written."""
        feed = self._content.feed
        recorder = None if feed is None else feed.recorder
        return None if recorder is None else Path(recorder).name

    def _recording(self, name: str, file: str | None = None) -> Path:
        path = self._content.recordings.path(name, file)
        if path is None:
            raise _RefusedError(404, "no such recording")
        return path

    async def playback(self, request: Request) -> Response:
        # It is asked first, and the present flight has grown since.
        played = await self._played(request, lambda playback: playback.summary(), anew=True)
        return _json({"name": request.path_params["name"], **played})

    async def playback_frames(self, request: Request) -> Response:
        from_s, to_s = (_number(request, name) for name in ("from", "to"))
        frames = await self._played(request, lambda playback: playback.frames(from_s, to_s))
        return _json({"frames": frames})

    async def playback_site(self, request: Request) -> Response:
        return _json(await self._played(request, lambda playback: playback.site()))

    async def _played(
        self, request: Request, ask: Callable[[Playback], Any], *, anew: bool = False
    ) -> Any:
        path = self._recording(request.path_params["name"])

        def answer() -> Any:
            open_playback = self._content.open_playback
            if open_playback is None:
                raise _RefusedError(404, "this page plays nothing back")
            if anew or self._playback is None or self._playback[0] != path:
                self._playback = None
                self._playback = (path, open_playback(path))
            return ask(self._playback[1])

        return await asyncio.get_running_loop().run_in_executor(self._thread, answer)

    async def what_if(self, request: Request) -> Response:
        document = await _document(request) if request.method == "POST" else None

        def answer() -> dict[str, Any]:
            make = self._content.make_what_if
            if make is None:
                raise _RefusedError(404, "this page has no site to change")
            self._what_if = self._what_if or make()
            return self._what_if.document() if document is None else self._what_if.answer(document)

        sender = request.client.host if request.client else ""
        try:
            return _json(await self._newest.answer(sender, answer))
        except SupersededError as error:
            raise _RefusedError(429, "a newer request came") from error


class _FileAsItWas(FileResponse):
    """A file with the bytes of the request's time: one that is being recorded grows meanwhile."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sends the bytes that the headers have announced."""
        left_bytes, ended = 0, False

        async def send_announced(message: Message) -> None:
            nonlocal left_bytes, ended
            if message["type"] == "http.response.start":
                left_bytes = int(Headers(raw=message["headers"])["content-length"])
                await send(message)
            elif not ended:
                body = message["body"][:left_bytes]
                left_bytes -= len(body)
                ended = not (message.get("more_body") and left_bytes)
                await send({**message, "body": body, "more_body": not ended})

        await super().__call__(scope, receive, send_announced)


async def _send_frames(websocket: WebSocket, feed: LiveFeed) -> None:
    """Sends frames as the viewer takes them; ends for a viewer that takes none."""
    with contextlib.suppress(asyncio.TimeoutError, WebSocketDisconnect):
        async for frame in feed.frames():
            await asyncio.wait_for(websocket.send_text(frame), _SEND_S)


async def _document(request: Request) -> dict[str, Any]:
    """The body, a JSON object. Raises _RefusedError."""
    try:
        body = await asyncio.wait_for(_body(request), _BODY_S)
    except (asyncio.TimeoutError, ClientDisconnect) as error:
        raise _RefusedError(408, "the request has no end") from error
    try:
        document = json.loads(body, parse_constant=_not_finite)
    except (ValueError, RecursionError) as error:
        raise _RefusedError(400, "must be JSON") from error
    if not isinstance(document, dict):
        raise _RefusedError(400, "must be a JSON object")
    return document


async def _body(request: Request) -> bytes:
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > _LONGEST_BODY:
            raise _RefusedError(413, f"must have at most {_LONGEST_BODY} bytes")
    return body


def _not_finite(word: str) -> None:
    raise ValueError(word)


def _number(request: Request, name: str) -> float:
    """A time of the query, in seconds."""
    try:
        time_s = float(request.query_params[name])
    except (KeyError, ValueError):
        time_s = math.nan
    if math.isnan(time_s):
        raise _RefusedError(400, f"{name} must be a time in seconds")
    return min(max(time_s, 0.0), 1e9)
