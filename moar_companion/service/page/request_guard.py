"""Refuses requests for other hosts and of other sites, before anything answers them (ASGI).

Each response has headers that keep a browser from running, framing or guessing anything else.
"""

from __future__ import annotations

from collections.abc import Collection
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .live_state import json_text
from .request_checks import host_refusal, origin_refusal

_MISDIRECTED, _FORBIDDEN = 421, 403


class RequestGuard:
    """An application behind the checks. tile_url: of a map, whose images may be loaded."""

    def __init__(
        self, application: ASGIApp, allowed_hosts: Collection[str], tile_url: str | None
    ) -> None:
        self._application = application
        self._allowed_hosts = allowed_hosts
        self._headers = _headers(tile_url)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answers one request."""

        async def send_guarded(message: Message) -> None:
            if message["type"] in {"http.response.start", "websocket.http.response.start"}:
                message["headers"] = [*message.get("headers", ()), *self._headers]
            await send(message)

        headers = {
            name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]
        }
        refusal, status = host_refusal(headers.get("host"), self._allowed_hosts), _MISDIRECTED
        if refusal is None:
            navigates = scope["type"] == "http" and scope["path"] == "/"
            refusal, status = origin_refusal(headers, navigates=navigates), _FORBIDDEN
        if refusal is None:
            await self._application(scope, receive, send_guarded)
            return
        kind = "http.response" if scope["type"] == "http" else "websocket.http.response"
        content_type = (b"content-type", b"application/json")
        await send_guarded({"type": f"{kind}.start", "status": status, "headers": [content_type]})
        body = json_text({"problem": refusal}).encode()
        await send({"type": f"{kind}.body", "body": body})


def _headers(tile_url: str | None) -> list[tuple[bytes, bytes]]:
    tiles = ""
    if tile_url is not None:
        parts = urlsplit(tile_url)
        tiles = f" {parts.scheme}://{parts.netloc}"
    policy = (
        f"default-src 'self'; img-src 'self' data: blob:{tiles}; frame-ancestors 'none'; "
        "base-uri 'none'; form-action 'none'; object-src 'none'"
    )
    values = {
        "content-security-policy": policy,
        "cross-origin-opener-policy": "same-origin",
        "cross-origin-resource-policy": "same-origin",
        "referrer-policy": "no-referrer",
        "x-content-type-options": "nosniff",
        "x-frame-options": "DENY",
        "cache-control": "no-cache",
    }
    return [(name.encode(), value.encode()) for name, value in values.items()]
