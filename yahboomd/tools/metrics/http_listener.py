"""The HTTP listener for scrapers: one page, bounded in time, size and number.

A browser on the same machine reaches loopback too. If a website's name points there (DNS
rebinding), the website could read the answer. So the Host header must be an address, ``localhost``
or a name that was allowed. No request changes anything.
"""

from __future__ import annotations

import asyncio
import ipaddress
import os
import re
from collections import Counter
from collections.abc import Callable, Collection
from typing import Final, Self

import msgspec

from yahboomd.core.errors import ListenError
from yahboomd.tools.metrics.exposition import CLASSIC, OPENMETRICS, wants_openmetrics

PATH = "/metrics"

MAX_HEAD = 8192
MAX_OPEN = 16
"""Simultaneous connections; one more closes the oldest."""

READ_S = 5.0
WRITE_S = 10.0
"""Time for a scraper to send its request, and to read the answer."""

OUTCOMES: Final = (
    *("answered", "bad_request", "bad_host", "bad_method", "bad_path"),
    *("too_slow", "gone", "crowded_out"),
)
"""Outcomes of a connection, each counted."""

_PLACE = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[^\[\]:]+)(?::(?P<port>\d{1,5}))?\Z")
_REASONS = {200: "OK", 400: "Bad Request", 404: "Not Found", 405: "Method Not Allowed"} | {
    421: "Misdirected Request"
}


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """An address to listen on.

    Attributes:
        port: 0 for any free one.
    """

    host: str
    port: int

    @classmethod
    def of(cls, text: str) -> Self | None:
        """Read ``127.0.0.1:9448``, ``[::1]:9448`` or ``localhost:9448``; None for anything else."""
        found = _PLACE.match(text)
        if found is None or found["port"] is None or int(found["port"]) > 65535:
            return None
        host = "127.0.0.1" if found["host"] == "localhost" else found["host"].strip("[]")
        return cls(host=host, port=int(found["port"])) if _is_address(host) else None

    @property
    def is_loopback(self) -> bool:
        """Whether only programs on this machine reach it."""
        return ipaddress.ip_address(self.host).is_loopback

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


class MetricsListener:
    """Answers ``GET /metrics``. An asynchronous context manager.

    Args:
        render: Makes the page, in OpenMetrics or in the older format.
        names: Host names, besides ``localhost`` and addresses, that scrapers may use.
    """

    def __init__(
        self, place: Place, render: Callable[[bool], str], *, names: Collection[str] = ()
    ) -> None:
        self.outcomes: Counter[str] = Counter(dict.fromkeys(OUTCOMES, 0))
        self._place = place
        self._render = render
        self._names = frozenset(name.lower() for name in names)
        self._server: asyncio.Server | None = None
        self._open: dict[asyncio.StreamWriter, asyncio.Task[None] | None] = {}

    async def __aenter__(self) -> Self:
        place = self._place
        try:
            self._server = await asyncio.start_server(
                self._connected, place.host, place.port, limit=MAX_HEAD, backlog=MAX_OPEN
            )
        except OSError as error:
            raise ListenError(
                f"The metrics cannot be served at {place}: {os.strerror(error.errno or 0)}.",
                remedy="Choose another address or port with --listen.",
            ) from error
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._server is not None:
            self._server.close()
        tasks = [task for task in self._open.values() if task is not None]
        for writer in self._open:
            writer.transport.abort()
        await asyncio.gather(*tasks)

    @property
    def place(self) -> Place:
        """The address on which it listens, with the actual port."""
        if self._server is None:
            return self._place
        host, port = self._server.sockets[0].getsockname()[:2]
        return Place(host=host, port=port)

    async def _connected(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open[writer] = asyncio.current_task()
        if len(self._open) > MAX_OPEN:
            oldest = next(iter(self._open))
            oldest.transport.abort()
            self._open.pop(oldest)
            self.outcomes["crowded_out"] += 1
        outcome = "gone"
        try:
            outcome = await self._converse(reader, writer)
            writer.close()
        finally:
            if writer in self._open:
                del self._open[writer]
                self.outcomes[outcome] += 1
            if outcome in {"too_slow", "gone"}:
                writer.transport.abort()

    async def _converse(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> str:
        try:
            async with asyncio.timeout(READ_S):
                head = await reader.readuntil(b"\r\n\r\n")
            outcome, answer = self._answer(head)
        except asyncio.LimitOverrunError:
            outcome, answer = "bad_request", _page(400, f"At most {MAX_HEAD} bytes of header.")
        except TimeoutError:
            return "too_slow"
        except (asyncio.IncompleteReadError, ConnectionError):
            return "gone"
        # With this drain() waits until the kernel has accepted everything.
        writer.transport.set_write_buffer_limits(high=0)
        try:
            writer.write(answer)
            async with asyncio.timeout(WRITE_S):
                await writer.drain()
        except TimeoutError:
            return "too_slow"
        except ConnectionError:
            return "gone"
        return outcome

    def _answer(self, head: bytes) -> tuple[str, bytes]:
        request, *lines = head.decode("latin-1").split("\r\n")
        words = request.split(" ")
        headers = [
            (name.strip().lower(), value.strip())
            for name, colon, value in (line.partition(":") for line in lines)
            if colon
        ]
        hosts = [value for name, value in headers if name == "host"]
        if len(words) != 3 or not words[2].startswith("HTTP/1.") or len(hosts) != 1:
            return "bad_request", _page(400, "This is no request of HTTP/1.1.")
        method, target, _ = words
        if not self._may_ask(hosts[0]):
            return "bad_host", _page(
                421,
                "Refused: the metrics are not served under this name, because any website could "
                "have it point here. Ask by address, or allow the name: "
                "yahboomd metrics --host-name NAME.",
            )
        if target.partition("?")[0] != PATH:
            return "bad_path", _page(404, f"The metrics are at {PATH}.")
        if method not in {"GET", "HEAD"}:
            return "bad_method", _page(405, "The metrics can only be read: GET.")
        openmetrics = wants_openmetrics(",".join(v for name, v in headers if name == "accept"))
        kind = OPENMETRICS if openmetrics else CLASSIC
        return "answered", _page(200, self._render(openmetrics), kind, body=method == "GET")

    def _may_ask(self, host: str) -> bool:
        found = _PLACE.match(host)
        if found is None:
            return False
        name = found["host"].lower().rstrip(".")
        return name == "localhost" or name in self._names or _is_address(name.strip("[]"))


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _page(
    status: int, text: str, kind: str = "text/plain; charset=utf-8", *, body: bool = True
) -> bytes:
    content = text.encode() if status == 200 else f"{text}\n".encode()
    head = (
        f"HTTP/1.1 {status} {_REASONS[status]}\r\n"
        f"Content-Type: {kind}\r\n"
        f"Content-Length: {len(content)}\r\n"
        f"{'Allow: GET, HEAD' + chr(13) + chr(10) if status == 405 else ''}"
        "X-Content-Type-Options: nosniff\r\n"
        "Cache-Control: no-store\r\n"
        "Connection: close\r\n\r\n"
    )
    return head.encode() + (content if body else b"")
