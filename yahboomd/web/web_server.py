"""The web server: listens, limits connections, and shuts down in order.

When a limit is exceeded, the address with the most waiting connections loses its oldest one. So a
new connection, which may carry an emergency stop, is always served.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import ssl
from collections import Counter
from collections.abc import Generator
from typing import TYPE_CHECKING, ClassVar, cast

import h11
from uvicorn import Config, Server
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import get_remote_addr
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

from yahboomd.core.errors import ListenError
from yahboomd.web.page_downloads import is_download
from yahboomd.web.page_session import MAX_BYTES
from yahboomd.web.web_application import HEADERS

if TYPE_CHECKING:
    from starlette.types import ASGIApp

MAX_OPEN = 192
"""The most connections that are not pages."""

WAIT_S = 10.0
"""Time for a connection to become a page or to send its request."""

UNSENT_BYTES = 16384
"""The most bytes queued for a slow page, here and in the kernel each."""

UNREAD_BYTES = 8192
"""The receive buffer requested from the kernel: a flood delivers no more than this at once."""

ODD_FRAMES = 20
"""Frames that no browser sends (pings, fragments) allowed at once; then one a second."""

BACKLOG = 1024

FILES = 4096
"""Open files: each connection costs one, also during its TLS handshake."""

VANISHED_MS = 20_000
"""Time for a page to acknowledge data, or the kernel closes its connection."""

BACKGROUND = {
    socket.AF_INET: (socket.IPPROTO_IP, socket.IP_TOS, 0x20),
    socket.AF_INET6: (socket.IPPROTO_IPV6, socket.IPV6_TCLASS, 0x20),
}
"""The socket option, by family, of the lowest priority (DSCP CS1)."""

TCP_NOTSENT_LOWAT = 25
"""Of linux/tcp.h."""


def listen(host: str, port: int) -> socket.socket:
    """Listen on an address.

    Raises:
        ListenError: It is in use, or does not belong to this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # Connections inherit it.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UNREAD_BYTES)
        listener.bind((host, port))
        # From now on the kernel queues connections.
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise ListenError(
            f"The page cannot be served at {host} port {port}: {os.strerror(error.errno or 0)}.",
            remedy="Does another `yahboomd web` run? Choose another port with --listen.",
        ) from error
    return listener


class WebServer(Server):
    """Serves an application until :attr:`should_exit`; the caller handles signals."""

    def __init__(self, application: ASGIApp, context: ssl.SSLContext | None) -> None:
        # WebSocket frames are not compressed, which would cost CPU for each page.
        config = WebConfig(
            application,
            http=CountedConnection,
            ws=PageSocket,
            lifespan="off",
            interface="asgi3",
            log_config=None,
            access_log=False,
            backlog=BACKLOG,
            proxy_headers=False,
            server_header=False,
            ws_max_size=MAX_BYTES,
            ws_per_message_deflate=False,
            ws_ping_interval=None,
            timeout_graceful_shutdown=1,
            h11_max_incomplete_event_size=16384,
        )
        config.load()
        config.tls = context
        # Its lines may contain text from clients.
        logging.getLogger("uvicorn").setLevel(logging.CRITICAL)
        super().__init__(config)

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None, None, None]:
        """Leave signals alone."""
        yield

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End every connection, also those in a TLS handshake."""
        for each in list(CountedConnection.waiting):
            if not each.begun:
                each.close()
        await super().shutdown(sockets)


class WebConfig(Config):
    """The settings of the server, which starts TLS itself: asyncio does not limit handshakes."""

    tls: ssl.SSLContext | None = None


class CountedConnection(H11Protocol):
    """One connection, counted until it becomes a page."""

    waiting: ClassVar[dict[CountedConnection, str]] = {}

    begun = False
    _deadline: asyncio.TimerHandle | None = None
    _socket: asyncio.Transport
    _entering: asyncio.Task[None] | None = None
    _early = b""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Count it, and close another one if there are too many."""
        self._socket = transport
        self._deadline = self.loop.call_later(WAIT_S, self._overdue)
        client = get_remote_addr(transport)
        self.waiting[self] = client[0] if client else ""
        if len(self.waiting) > MAX_OPEN:
            most = Counter(self.waiting.values()).most_common(1)[0][0]
            next(each for each, address in self.waiting.items() if address == most).close()
        context = cast("WebConfig", self.config).tls
        if context is None:
            self._begin(transport)
        else:
            self._entering = self.loop.create_task(self._enter(context), name="web-tls")

    async def _enter(self, context: ssl.SSLContext) -> None:
        if self._socket.is_closing():
            return
        # Ignore bytes from before the handshake.
        self._early = b""
        try:
            transport = await self.loop.start_tls(
                self._socket, self, context, server_side=True, ssl_handshake_timeout=WAIT_S
            )
        except OSError:
            transport = None
        if transport is None or transport.is_closing():
            self._leave()
            return
        self._begin(transport)
        if early := self._early:
            super().data_received(early)

    def _begin(self, transport: asyncio.Transport) -> None:
        self.begun = True
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=UNSENT_BYTES)
        own = transport.get_extra_info("socket")
        with contextlib.suppress(OSError):
            own.setsockopt(socket.IPPROTO_TCP, TCP_NOTSENT_LOWAT, UNSENT_BYTES)

    def data_received(self, data: bytes) -> None:
        """Process data; bytes that arrive with the end of the handshake are kept until it ends."""
        if self.begun:
            super().data_received(data)
        else:
            self._early += data

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget it."""
        self._leave()
        if self.begun:
            super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Become a page, which has its own limits."""
        self._leave()
        own = self.transport.get_extra_info("socket")
        with contextlib.suppress(OSError):
            # A page that vanished keeps no picture in memory for long.
            own.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, VANISHED_MS)
            if event.target.startswith(b"/camera"):
                # Radios and routers send beats and commands first.
                own.setsockopt(*BACKGROUND[own.family])
        super().handle_websocket_upgrade(event)
        if not cast("PageSocket", self.transport.get_protocol()).handshake_initiated:
            # It has a body, or too many headers: it would stay open without an answer.
            self.send_400_response("This is no request for a WebSocket.\n")

    def send_400_response(self, msg: str) -> None:
        """Refuse a request that is not HTTP, with the headers of every answer."""
        headers = {"content-type": "text/plain; charset=utf-8", "connection": "close", **HEADERS}
        answer = h11.Response(status_code=400, reason=b"Bad Request", headers=[*headers.items()])
        for event in (answer, h11.Data(data=msg.encode()), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def on_response_complete(self) -> None:
        """Restart the time for the next request."""
        super().on_response_complete()
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = self.loop.call_later(WAIT_S, self._overdue)

    def _leave(self) -> None:
        self.waiting.pop(self, None)
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _overdue(self) -> None:
        cycle = self.cycle
        if cycle is None or cycle.response_complete or not is_download(cycle.scope["path"]):
            self.close()
        else:
            # A download ends by itself if the browser stops reading.
            self._deadline = self.loop.call_later(WAIT_S, self._overdue)

    def close(self) -> None:
        """End it at once."""
        self._leave()
        if self._entering is not None:
            self._entering.cancel()
        (self.transport if self.begun else self._socket).abort()


class PageSocket(WebSocketsSansIOProtocol):
    """The WebSocket of one page."""

    _credit = float(ODD_FRAMES)
    _counted_s = 0.0

    def handle_ping(self) -> None:
        """Answer, unless the page sends too many or does not read the answers."""
        if self.transport.get_write_buffer_size() > UNSENT_BYTES:
            self.transport.abort()
        elif self._may_send():
            super().handle_ping()

    def handle_pong(self, _event: Frame) -> None:
        """Count it: we send no pings."""
        self._may_send()

    def handle_cont(self, event: Frame) -> None:
        """Keep a fragment of a message, unless there are too many, which may all be empty."""
        if self._may_send():
            super().handle_cont(event)

    def _may_send(self) -> bool:
        """Count an odd frame; disconnect a page that sends too many."""
        now_s = self.loop.time()
        self._credit = min(ODD_FRAMES, self._credit + now_s - self._counted_s) - 1.0
        self._counted_s = now_s
        if self._credit < 0.0:
            self.transport.abort()
        return self._credit >= 0.0
