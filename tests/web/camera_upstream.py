"""Stands for the server of a camera, in memory or on a socket: the test has it send bytes."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any, Self, cast

BOUNDARY = "frame"

OK = (
    "HTTP/1.0 200 OK\r\n"
    f"Content-Type: multipart/x-mixed-replace; boundary={BOUNDARY}\r\n\r\n--{BOUNDARY}\r\n"
).encode()


def jpeg(content: bytes | int = 0, *, width: int = 640, height: int = 480) -> bytes:
    """A JPEG by its headers; nobody could see it."""
    if isinstance(content, int):
        content = content.to_bytes(4, "big")
    size = height.to_bytes(2, "big") + width.to_bytes(2, "big")
    head = b"\xff\xd8\xff\xe0\x00\x04\x00\x00\xff\xc0\x00\x0b\x08" + size + b"\x01\x01\x11\x00"
    return head + b"\xff\xda" + content + b"\xff\xd9"


def part(picture: bytes, *, length: bool = True) -> bytes:
    """A part of the stream, with the boundary after it."""
    sized = f"Content-Length: {len(picture)}\r\n" if length else ""
    head = f"Content-Type: image/jpeg\r\n{sized}\r\n".encode()
    return head + picture + f"\r\n--{BOUNDARY}\r\n".encode()


class Line:
    """One connection, in memory."""

    def __init__(self) -> None:
        self.reader = asyncio.StreamReader()
        self.asked = b""
        self.is_open = True
        self.transport = SimpleNamespace(abort=self._end)

    def write(self, data: bytes) -> None:
        """As its client's writer does."""
        self.asked += data

    def _end(self) -> None:
        self.is_open = False

    def send(self, data: bytes) -> None:
        """Have these bytes arrive, if it is still open."""
        if self.is_open:
            self.reader.feed_data(data)

    def close(self) -> None:
        """End it from the camera's side."""
        self.reader.feed_eof()


class CameraInMemory:
    """The server, without sockets: for virtual time.

    Attributes:
        lines: The connections that were made, in order.
        made_s: When each was asked for, also in vain.
        greeting: Sent at once on each.
    """

    def __init__(self, greeting: bytes = OK) -> None:
        self.lines: list[Line] = []
        self.made_s: list[float] = []
        self.greeting = greeting
        self.is_there = True

    async def connect(self, _host: str, _port: int) -> tuple[asyncio.StreamReader, Any]:
        """In place of the connection over TCP."""
        self.made_s.append(asyncio.get_running_loop().time())
        if not self.is_there:
            raise ConnectionRefusedError(111, "Connection refused")
        line = Line()
        line.send(self.greeting)
        self.lines.append(line)
        return line.reader, cast("asyncio.StreamWriter", line)

    @property
    def open_lines(self) -> int:
        """The number of open connections."""
        return sum(line.is_open for line in self.lines)


class CameraOnSocket:
    """The same on a real socket: ``async with CameraOnSocket() as camera``."""

    def __init__(self) -> None:
        self.writers: list[asyncio.StreamWriter] = []
        self.asked: list[bytes] = []

    async def __aenter__(self) -> Self:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        port = self._server.sockets[0].getsockname()[1]
        self.address = f"http://127.0.0.1:{port}/?action=stream"
        return self

    async def __aexit__(self, *_why: object) -> None:
        for writer in self.writers:
            writer.transport.abort()
        self._server.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.asked.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(OK)
        self.writers.append(writer)
        # Until the client leaves.
        await reader.read()
        self.writers.remove(writer)
        writer.transport.abort()

    def send(self, picture: bytes) -> None:
        """A picture to every client."""
        for writer in self.writers:
            writer.write(part(picture))
