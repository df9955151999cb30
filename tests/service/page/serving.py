"""A page that is served in this process, and clients of it that are no browsers."""

from __future__ import annotations

import asyncio
import contextlib
import http.client
import json
import queue
import threading
from collections.abc import Iterator

from websockets.sync.client import connect

from moar_companion.service.page.page_server import PageContent, serve
from moar_companion.service.page_process import listen

TOKEN = "a-token-of-the-page"
PATIENCE_S = 20.0


class Served:
    """A page on a port of this computer. loop: in which it is served."""

    def __init__(self, port: int, loop: asyncio.AbstractEventLoop) -> None:
        self.port, self.loop = port, loop
        self.host = f"127.0.0.1:{port}"

    def ask(self, method, path, *, body=None, token=None, **headers):
        """Status, headers and body of a response; a body that is JSON is read."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        if token is not None:
            headers["Authorization"] = f"Bearer {token}"
        if isinstance(body, dict):
            body = json.dumps(body)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        with contextlib.closing(client):
            client.request(method, path, body=body, headers=named)
            response = client.getresponse()
            content = response.read()
        if response.headers.get_content_type() == "application/json":
            content = json.loads(content)
        return response.status, response.headers, content

    def viewer(self, **options):
        """A viewer of the live state."""
        return connect(f"ws://{self.host}/live", compression=None, **options)

    def call(self, call, *given):
        """Result of a call in the page's loop."""

        async def called():
            return call(*given)

        return asyncio.run_coroutine_threadsafe(called(), self.loop).result(PATIENCE_S)


@contextlib.contextmanager
def served(content: PageContent) -> Iterator[Served]:
    """Serves in a thread until the end."""
    listener = listen("127.0.0.1", 0)
    loops = queue.Queue()
    ending = asyncio.Event()

    async def run():
        loops.put(asyncio.get_running_loop())
        serving = asyncio.create_task(serve(content, listener))
        await ending.wait()
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    loop = loops.get(timeout=PATIENCE_S)
    try:
        yield Served(listener.getsockname()[1], loop)
    finally:
        loop.call_soon_threadsafe(ending.set)
        thread.join(PATIENCE_S)
        listener.close()
