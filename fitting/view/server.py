"""The page's server: files of the package and one websocket, by aiohttp, in a thread.

It answers nobody who does not know its token: the address that is printed holds it, and the
browser keeps it as a cookie. A request has to name this server as its host, or any web site
could reach it through a name of its own, and a websocket's origin has to be this server. The
page may load nothing from elsewhere (Content-Security-Policy).

Connections are bounded, and one without a whole request is closed after some seconds: whoever
sends a byte now and then keeps nobody out for long.
"""

import asyncio
import contextlib
import ipaddress
import json
import logging
import os
import threading
import time
from pathlib import Path
from typing import Any, Self

from aiohttp import WSMsgType, web

from fitting.credential import is_token, own_token
from fitting.json_text import json_text
from fitting.view.hub import Hub, understood

_PAGE = Path(__file__).parent / "page"
_TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".txt": "text/plain",
}
_FILES = {path.name: path for path in _PAGE.iterdir() if path.suffix in _TYPES}
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}
_LOGGER = logging.getLogger("suas view")
# Of requests that make no sense aiohttp would write the whole stack.
_LOGGER.disabled = not os.environ.get("SUAS_TRACEBACK")
_RATE = 30.0  # pictures a second at most
_UNSEEN = 1.0  # a page that draws nothing (a hidden tab) gets a picture so often [s]
_MOST_BYTES = 4096  # of a message from a page
_MOST_PAGES = 8
_BEAT = 10.0  # between two looks whether a page is still there [s]
_PATIENCE = 10.0  # with a connection that sends no whole request [s]
_MOST_CONNECTIONS = 128


class ViewServer:
    """Serves the page of a hub; a context manager that starts and ends it.

    The address `host` is listened at; the port 0 takes a free one.
    Raises OSError: the address can't be listened at; ValueError: the environment's token is
    none.
    """

    def __init__(self, hub: Hub, host: str, port: int) -> None:
        # how many pages are open now, and the address of the page, with the token
        self.hub, self.pages, self.url = hub, 0, ""
        self._host, self._port, self._token = host, port, own_token()
        self._loop = asyncio.new_event_loop()
        self._news = asyncio.Event()
        self._end = asyncio.Event()
        self._ready = threading.Event()
        self._failure: OSError | None = None
        self._thread = threading.Thread(target=self._run, name="suas view", daemon=True)
        hub.on_news = self._wake

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        if self._failure is not None:
            raise self._failure
        return self

    def __exit__(self, *_: object) -> None:
        self.hub.close()
        with contextlib.suppress(RuntimeError):  # it has ended already
            self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(timeout=5)

    def _run(self) -> None:
        with contextlib.closing(self._loop) as loop:
            loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        application = web.Application(middlewares=[self._only_own], client_max_size=_MOST_BYTES)
        application.router.add_get("/socket", self._socket)
        application.router.add_get("/{name:.*}", self._file)
        runner = web.AppRunner(
            application,
            access_log=None,
            logger=_LOGGER,
            shutdown_timeout=1.0,
            keepalive_timeout=_PATIENCE,
        )
        await runner.setup()
        server = runner.server
        assert server is not None

        def accepted() -> asyncio.BaseProtocol:
            full = len(server.connections) >= _MOST_CONNECTIONS
            return _Refusal() if full else server()

        try:
            listener = await self._loop.create_server(accepted, self._host, self._port)
            port = listener.sockets[0].getsockname()[1]
            name = f"[{self._host}]" if ":" in self._host else self._host
            self._port = port
            self.url = f"http://{name}:{port}/?token={self._token}"
            self._ready.set()
            await self._end.wait()
            listener.close()
        except OSError as error:
            self._failure = OSError(
                error.errno, error.strerror or str(error), f"{self._host}:{self._port}"
            )
        finally:
            self._ready.set()
            await runner.cleanup()

    def _wake(self) -> None:
        """Called from the source's thread."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._news.set)

    @web.middleware
    async def _only_own(self, request: web.Request, handler: Any) -> web.StreamResponse:
        try:
            if not _is_own_name(_named_host(request), self._host):
                raise web.HTTPForbidden(text="this server has another name")
            self._admit(request)
            response: web.StreamResponse = await handler(request)
        except web.HTTPException as refusal:
            refusal.headers.update(_HEADERS)
            raise
        if not response.prepared:
            response.headers.update(_HEADERS)
        return response

    def _admit(self, request: web.Request) -> None:
        """Let those pass whose cookie is the token; make a cookie of a token in the address.

        Raises HTTPSeeOther: the page without the token in its address, which is a cookie now;
        HTTPForbidden: there is no token, or another.
        """
        cookie = f"suas_view_{self._port}"  # cookies do not tell ports apart
        if is_token(request.query.get("token", ""), self._token):
            onwards = web.HTTPSeeOther("/")
            onwards.set_cookie(cookie, self._token, httponly=True, samesite="Lax")
            raise onwards
        if not is_token(request.cookies.get(cookie, ""), self._token):
            raise web.HTTPForbidden(text="open the address that `suas view` printed")

    async def _file(self, request: web.Request) -> web.Response:
        path = _FILES.get(request.match_info["name"] or "index.html")
        if path is None:
            raise web.HTTPNotFound(text="this server has no such file; its page is at /")
        kind = _TYPES[path.suffix]
        return web.Response(body=path.read_bytes(), content_type=kind, charset="utf-8")

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        origin = request.headers.get("Origin", "")
        if origin != f"{request.scheme}://{request.host}":
            raise web.HTTPForbidden(text=f"{origin}: not a page of this server")
        if self.pages >= _MOST_PAGES:
            raise web.HTTPServiceUnavailable(text=f"{_MOST_PAGES} pages are open already")
        socket = web.WebSocketResponse(max_msg_size=_MOST_BYTES, heartbeat=_BEAT)
        await socket.prepare(request)
        self.pages += 1
        page = _Page(self.hub, socket)
        sender = asyncio.create_task(page.send(self._news))
        closer = asyncio.create_task(self._close(socket))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    page.take(message.data)
        finally:
            self.pages -= 1
            for task in (sender, closer):
                task.cancel()
            await asyncio.gather(sender, closer, return_exceptions=True)
        return socket

    async def _close(self, socket: web.WebSocketResponse) -> None:
        await self._end.wait()
        await socket.close()


class _Page:
    """One open page: never more than one picture on its way to it."""

    def __init__(self, hub: Hub, socket: web.WebSocketResponse) -> None:
        self._hub, self._socket = hub, socket
        self._sent = 0
        self._made = 0.0
        self._drawn = asyncio.Event()

    async def send(self, news: asyncio.Event) -> None:
        """Send description and history, then the newest picture again and again."""
        await self._socket.send_str(json_text({"type": "skin", **self._hub.description}))
        told = -1
        while not self._socket.closed:
            if told != self._hub.edition:
                told = self._hub.edition
                await self._socket.send_str(json_text(self._hub.history()))
            message = self._hub.newest(self._sent)
            if message is None:
                news.clear()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(news.wait(), _UNSEEN)
                continue
            self._sent, self._made = message.number, message.made
            self._drawn.clear()
            begun = time.monotonic()
            await self._socket.send_bytes(message.content)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._drawn.wait(), _UNSEEN)
            await asyncio.sleep(max(0.0, begun + 1 / _RATE - time.monotonic()))

    def take(self, text: str) -> None:
        """Take a message of the page; what isn't understood is left out."""
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            return
        if not isinstance(message, dict):
            return
        if message.get("type") == "drawn":
            if message.get("number") == self._sent and not self._drawn.is_set():
                self._hub.drawn(time.monotonic() - self._made)
                self._drawn.set()
            return
        wish = understood(message, self._hub.description)
        if wish is not None:
            self._hub.wish(*wish)


class _Refusal(asyncio.Protocol):
    """A connection above what is allowed: answered without a look at what it asks."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        text = f"{_MOST_CONNECTIONS} connections are open already\n"
        head = f"HTTP/1.1 503 Service Unavailable\r\nContent-Length: {len(text)}\r\n"
        transport.write(f"{head}Connection: close\r\n\r\n{text}".encode())
        transport.close()


def _named_host(request: web.Request) -> str:
    """The host that a request names, without its port; empty where it makes no sense."""
    try:
        return request.url.host or ""
    except ValueError:
        return ""


def _is_own_name(name: str, host: str) -> bool:
    """Whether a request's host may be this server's: an address, its own, or localhost."""
    if name in (host, "localhost"):
        return True
    with contextlib.suppress(ValueError):
        ipaddress.ip_address(name)
        return True
    return False
