"""Files that pages download: recordings and black boxes, listed and sent in pieces."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from starlette.requests import HTTPConnection, Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from yahboomd.web.page_tools import PageTools
from yahboomd.web.session_files import Role
from yahboomd.web.session_routes import json_answer

if TYPE_CHECKING:
    from starlette.types import Message, Receive, Scope, Send

CHUNK_BYTES = 65536

STALLED_S = 20.0
"""A browser that takes no data for this time is disconnected."""

AT_ONCE = 8

AT_ONCE_VIEWERS = 4
"""The most downloads of viewers among them, so that drivers find room."""

AT_ONCE_VIEWER = 2
"""The most downloads of viewers from one address."""


class Downloads:
    """The routes.

    Args:
        role: Returns the role of the person who asks; None without a session.
    """

    def __init__(self, tools: PageTools, role: Callable[[HTTPConnection], Role | None]) -> None:
        self._recordings = tools.recordings
        self._boxes = tools.boxes
        self._role = role
        self._running = list[str | None]()
        """The address of each viewer's download; None for a driver's."""
        self.routes = [
            Route("/recordings", self._list, methods=["GET"]),
            Route("/recordings/{name}/{file}", self._recording, methods=["GET"]),
            Route("/boxes", self._list_boxes, methods=["GET"]),
            Route("/boxes/{name}", self._box, methods=["GET"]),
            Route("/boxes/{name}/words", self._box_in_words, methods=["GET"]),
        ]

    async def _list(self, request: Request) -> Response:
        if self._role(request) is None:
            return _refused(401)
        return json_answer(200, **await asyncio.to_thread(self._recordings.listed))

    async def _recording(self, request: Request) -> Response:
        role = self._role(request)
        if role is None:
            return _refused(401)
        name, file = request.path_params["name"], request.path_params["file"]
        path = await asyncio.to_thread(self._recordings.file, name, file)
        if path is None:
            return _refused(404)
        return await self._download(path, f"{name}-{file}", _viewer(request, role))

    async def _list_boxes(self, request: Request) -> Response:
        return (
            _refused(401)
            if self._role(request) is None
            else json_answer(200, **await self._boxes.listed())
        )

    async def _box_in_words(self, request: Request) -> Response:
        if self._role(request) is None:
            return _refused(401)
        found = await self._boxes.explained(request.path_params["name"])
        return _refused(404) if found is None else json_answer(200, **found)

    async def _box(self, request: Request) -> Response:
        role = self._role(request)
        if role is None:
            return _refused(401)
        path = await self._boxes.file(request.path_params["name"])
        if path is None:
            return _refused(404)
        return await self._download(path, path.name, _viewer(request, role))

    async def _download(self, path: Path, name: str, viewer: str | None) -> Response:
        if self._is_full(viewer):
            return _refused(503)
        # Count it before the file is opened, since others may ask meanwhile.
        self._running.append(viewer)
        try:
            file, size = await asyncio.to_thread(_opened, path)
        except BaseException as error:
            self._running.remove(viewer)
            if isinstance(error, OSError):
                return _refused(404)
            raise
        return _Download(file, size, name, lambda: self._running.remove(viewer))

    def _is_full(self, viewer: str | None) -> bool:
        viewers = [each for each in self._running if each is not None]
        return len(self._running) >= AT_ONCE or (
            viewer is not None
            and (len(viewers) >= AT_ONCE_VIEWERS or viewers.count(viewer) >= AT_ONCE_VIEWER)
        )


class _Download(StreamingResponse):
    """A file with its size at the request: one that is being recorded grows."""

    def __init__(self, file: BinaryIO, size: int, name: str, ended: Callable[[], None]) -> None:
        self._file = file
        self._ended = ended
        super().__init__(
            self._chunks(size),
            media_type="application/octet-stream",
            headers={
                "content-length": str(size),
                "content-disposition": f'attachment; filename="{name}"',
                "cache-control": "no-store",
            },
        )

    async def _chunks(self, size: int) -> AsyncIterator[bytes]:
        left = size
        while left > 0:
            chunk = await asyncio.to_thread(self._file.read, min(left, CHUNK_BYTES))
            if not chunk:
                return
            left -= len(chunk)
            yield chunk

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_soon(message: Message) -> None:
            async with asyncio.timeout(STALLED_S):
                await send(message)

        try:
            await super().__call__(scope, receive, send_soon)
        finally:
            self._file.close()
            self._ended()


def is_download(path: str) -> bool:
    """Whether the answer to a request may take long."""
    return path.startswith(("/recordings/", "/boxes"))


def _viewer(request: Request, role: Role) -> str | None:
    """The address of a viewer; None for a driver."""
    if role == "driver":
        return None
    return request.client.host if request.client else ""


def _opened(path: Path) -> tuple[BinaryIO, int]:
    file = path.open("rb")
    return file, path.stat().st_size


def _refused(status: int) -> Response:
    words = {
        401: "Open the link, or scan the code, that the terminal on the robot shows.",
        404: "There is no such file.",
        503: "Too many downloads at once. Try again when one has ended.",
    }
    return PlainTextResponse(f"{words[status]}\n", status)
