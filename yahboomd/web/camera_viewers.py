"""Pages that look at the camera: each asks for one picture after the other, and gets the newest.

A page that is slow asks seldom, so it skips pictures and no queue grows. Its WebSocket is another
one than that of its commands, which no picture delays.
"""

from __future__ import annotations

import asyncio
import contextlib
import struct
from collections.abc import Callable

from starlette.websockets import WebSocket, WebSocketDisconnect

from yahboomd.core.clock import Clock
from yahboomd.web.camera_feed import CameraFeed
from yahboomd.web.page_frames import Role, part

MAX_LOOKING = 16
MAX_LOOKING_VIEWERS = 12
"""The most pages of viewers among them, so that drivers always find room."""

ANSWER_S = 1.0
"""A page that asks gets an answer after this time at the latest: it sees that the server lives."""

IDLE_S = 10.0
"""A page that asks for nothing in this time looks no longer."""

COUNTS = "counts"
"""The question for the counts; every other one is for a picture."""

COUNTS_S = 0.05
"""The pause after counts: three pages that asked for them without end delayed commands by 0.3 s."""

HEAD = struct.Struct(">II")
"""Before each picture: the milliseconds since it arrived here, and those that the page waited."""

POLICY, FULL = 1008, 1013
NS_PER_MS = 1_000_000


class CameraViewers:
    """Serves the camera to pages."""

    def __init__(self, feed: CameraFeed, clock: Clock) -> None:
        self._feed = feed
        self._clock = clock
        self._looking: list[Role] = []

    async def attend(self, socket: WebSocket, role: Callable[[], Role | None]) -> None:
        """Serve one page until it leaves, or falls silent.

        Args:
            role: Who looks; asked again before every picture, None ends it.
        """
        who = role()
        viewers = self._looking.count("viewer")
        if who is None:
            return
        if len(self._looking) >= MAX_LOOKING or (
            who == "viewer" and viewers >= MAX_LOOKING_VIEWERS
        ):
            text = f"{len(self._looking)} pages look already. Close one."
            await socket.close(FULL, text)
            return
        self._looking.append(who)
        try:
            with self._feed.looked_at(), contextlib.suppress(WebSocketDisconnect):
                await self._serve(socket, role)
        finally:
            self._looking.remove(who)

    async def _serve(self, socket: WebSocket, role: Callable[[], Role | None]) -> None:
        number, problem = 0, ""
        while (question := await _question(socket)) is not None:
            asked_ns = self._clock.now_ns()
            picture = None
            if question != COUNTS:
                picture = await self._feed.news(number, problem, ANSWER_S)
            if role() is None:
                await socket.close(POLICY, "This session has ended.")
                return
            if picture is None:
                problem = self._feed.problem
                await socket.send_text(
                    part("camera", problem=problem, counts=self._feed.counts).decode()
                )
                if question == COUNTS:
                    await asyncio.sleep(COUNTS_S)
                continue
            number, problem = picture.number, ""
            age_ns = self._feed.age_ns(picture)
            waited_ns = self._clock.now_ns() - asked_ns
            head = HEAD.pack(age_ns // NS_PER_MS + 1, waited_ns // NS_PER_MS)
            await socket.send_bytes(head + picture.jpeg)


async def _question(socket: WebSocket) -> str | None:
    """Wait for a page's next question; None if it left or fell silent."""
    try:
        async with asyncio.timeout(IDLE_S):
            return await socket.receive_text()
    except TimeoutError:
        await socket.close()
    except (WebSocketDisconnect, KeyError):
        pass
    return None
