"""Serves the page and its data: signals as packed rows, everything else as JSON, one coroutine per reader.

A slow reader skips rows: unread ones stay in the session's ring buffers, which never grow. A connection serves one
request, and the number of connections is limited.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np
from aiohttp import WSMsgType, web

from optid.errors import InputError
from optid.live.page.access import PROTOCOL, Access, FailedAttempts
from optid.live.page.view import hello, news
from optid.live.session import Session

HERE = Path(__file__).parent
FILES = {
    "/": ("page.html", "text/html"),
    **{
        f"/{name}.js": (f"{name}.js", "text/javascript")
        for name in ("page", "chart", "window", "export", "panels")
    },
    "/page.css": ("page.css", "text/css"),
}
PACE = 0.1  # s between two messages to a reader
DRAWN = 250.0  # largest number of rows per second for a reader
POLL = 0.05  # s between polls of the session
HEARTBEAT = 30.0  # s: a reader that does not respond for half as long is disconnected
READERS = 8  # at a time
CONNECTIONS = 32  # at a time, including the readers'
HEADER_TIME = 5.0  # s within which a connection must have sent its request
LONGEST = 64 * 1024  # bytes of a command: a profile has some hundred levels
LAST_WORD = 2.0  # s for readers to fetch the end of the session
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src data:; frame-ancestors 'none'",
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class Page:
    """The page of a session.

    Args:
        session: to show and to control.
        access: of readers.
    """

    def __init__(self, session: Session, access: Access) -> None:
        self._session, self._access = session, access
        self._readers: set[asyncio.Task[Any]] = set()
        self._attempts, self._heard = FailedAttempts(), WeakSet[asyncio.BaseTransport]()
        self._stride = max(1, round(session.settings.rate / DRAWN))

    def application(self) -> web.Application:
        """The routes, with access control."""
        application = web.Application(middlewares=[self._guarded], client_max_size=4096)
        for route in FILES:
            application.router.add_get(route, self._file)
        application.router.add_get("/live", self._live)
        return application

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Any) -> web.StreamResponse:
        if request.transport is not None:
            self._heard.add(request.transport)
        self._access.admit(request)
        response: web.StreamResponse = await handler(request)
        return response

    def gate(self, server: web.Server) -> Callable[[], asyncio.Protocol]:
        """Makes the protocol of each new connection: at most `CONNECTIONS`, with a request within `HEADER_TIME`."""

        def overdue(protocol: Any) -> None:
            transport = protocol.transport
            if transport is not None and transport not in self._heard:
                transport.abort()

        def connected() -> asyncio.Protocol:
            if len(server.connections) >= CONNECTIONS:
                return _Full()
            protocol = server()
            asyncio.get_running_loop().call_later(HEADER_TIME, overdue, protocol)
            return protocol

        return connected

    async def _file(self, request: web.Request) -> web.Response:
        name, kind = FILES[request.path]
        text = (HERE / name).read_text(encoding="utf-8")
        response = web.Response(text=text, content_type=kind, charset="utf-8", headers=HEADERS)
        response.force_close()  # a connection that stays open would count
        return response

    def _check_token(self, request: web.Request) -> None:
        address = request.remote or ""
        wait = self._attempts.wait(address)
        if wait > 0.0:
            raise web.HTTPTooManyRequests(
                text=f"too many wrong tokens; try again in {wait:.0f} s\n",
                headers={"Retry-After": f"{wait:.0f}"},
            )
        if not self._access.opens(request):
            if self._attempts.wrong(address):
                self._session.events.note(
                    f"the page: too many wrong tokens from {address}; further attempts are delayed"
                )
            raise web.HTTPForbidden(text="the token is missing or wrong\n")

    async def _live(self, request: web.Request) -> web.WebSocketResponse:
        self._check_token(request)
        if len(self._readers) >= READERS:
            raise web.HTTPServiceUnavailable(text=f"{READERS} pages are open already\n")
        socket = web.WebSocketResponse(heartbeat=HEARTBEAT, max_msg_size=LONGEST, protocols=(PROTOCOL,))
        await socket.prepare(request)
        feeder = asyncio.create_task(self._feed(socket))
        self._readers.add(feeder)
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT and (said := self._obey(message.data)):
                    await socket.send_str(json.dumps({"kind": "answer", "words": said}))
        finally:
            self._readers.discard(feeder)
            feeder.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionError):
                await feeder
        return socket

    def _obey(self, text: str) -> str:
        """Carry out one command of the page; returns why it was refused. Unknown commands are refused."""
        try:
            message = json.loads(text)
        except (ValueError, RecursionError):
            return ""
        wish = message.get("do") if isinstance(message, dict) else None
        if wish == "stop":
            self._session.stop("the Stop button of the page")
        elif wish == "tune":
            self._session.tune()
        elif wish == "apply":
            self._session.apply(confirmed=message.get("confirmed") is True)
        elif wish == "reference" and isinstance(message.get("text"), str):
            try:
                self._session.demand(message["text"])
            except InputError as error:
                return str(error)
        return ""

    async def _feed(self, socket: web.WebSocketResponse) -> None:
        """Send updates repeatedly; the next message is made when the last one was sent."""
        session = self._session
        await socket.send_str(json.dumps(hello(session)))
        seen = slow = events = 0
        while not socket.closed:
            ended = session.end is not None
            seen, rows = session.signals.since(max(seen, session.signals.count - session.signals.rows // 2))
            first = -(seen - len(rows)) % self._stride
            rows = rows[first :: self._stride]
            if len(rows):
                await socket.send_bytes(np.ascontiguousarray(rows, dtype="<f8").tobytes())
            slow, parameters = session.slow.since(slow)
            told, events = events, session.events.number  # later events are for the next message
            await socket.send_str(json.dumps(news(session, parameters, told)))
            if ended:
                await socket.close(message=b"ended")
                return
            await asyncio.sleep(PACE)

    async def finish(self) -> None:
        """Let the readers receive the end of the session."""
        if self._readers:
            await asyncio.wait(self._readers, timeout=LAST_WORD)


class _Full(asyncio.Protocol):
    """Refuses a connection."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


@contextlib.asynccontextmanager
async def served(page: Page, access: Access, listening: socket.socket) -> AsyncIterator[str]:
    """The page's address, while it is served."""
    runner = web.AppRunner(page.application(), access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    assert runner.server is not None
    gate = page.gate(runner.server)
    server = await asyncio.get_running_loop().create_server(gate, sock=listening, backlog=CONNECTIONS)
    try:
        yield access.url(listening.getsockname()[1])
        await page.finish()
    finally:
        server.close()
        await runner.cleanup()


async def watch(
    session: Session,
    way_in: tuple[Access, socket.socket],
    open_at: Callable[[str], None],
    look: Callable[[], None],
) -> None:
    """Serve the page until the session has ended.

    Args:
        session: begun already or by `open_at`.
        way_in: access and socket.
        open_at: called once with the address.
        look: called after each poll.
    """
    access, listening = way_in
    page = Page(session, access)
    async with served(page, access, listening) as address:
        open_at(address)
        while session.end is None:
            session.poll()
            look()
            await asyncio.sleep(POLL)
