"""One page: its queued frames, the newest sample of each kind, and the limit of its own frames."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Mapping

from starlette.websockets import WebSocket

from yahboomd.core.clock import Clock
from yahboomd.core.model import NS_PER_S
from yahboomd.web.page_frames import Role, part
from yahboomd.web.phone_sessions import PhoneSession

QUEUED = 64
"""Events and answers kept for a slow page; the oldest are dropped and counted."""

STUCK_S = 5.0
"""A page that takes no data for this time is closed."""

FRAMES_PER_S = 100
"""Frames that a page may send; it needs 22."""

BURST = 200


class PageSession:
    """An accepted WebSocket.

    Args:
        number: Tells it from other pages.
        phone: The session of its phone; None if everybody may drive.
        joined: The latest beat when it connected.
    """

    def __init__(
        self,
        number: int,
        phone: PhoneSession | None,
        socket: WebSocket,
        clock: Clock,
        joined: int,
    ) -> None:
        self.number = number
        self.phone = phone
        self.role: Role = "driver" if phone is None else phone.role
        self.ended: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        """The reason, once its session has ended: nothing that it sends counts from then on."""
        self.joined = joined
        self.refused_ns = 0
        self.requests = set[asyncio.Task[None]]()
        self._socket = socket
        self._clock = clock
        self._newest: dict[str, bytes] = {}
        self._queue: deque[bytes] = deque()
        self._lost = 0
        self._wake = asyncio.Event()
        self._credit = float(BURST)
        self._counted_ns = clock.now_ns()

    @property
    def name(self) -> str:
        """Its name for people."""
        return f"Page {self.number}" if self.phone is None else self.phone.name

    def show(self, parts: Mapping[str, bytes]) -> None:
        """Send these soon; newer ones of the same kind replace them."""
        self._newest.update(parts)
        self._wake.set()

    def queue(self, each: bytes) -> None:
        """Send this, in order; a page that is too slow loses the oldest and learns how many."""
        if len(self._queue) >= QUEUED:
            self._queue.popleft()
            self._lost += 1
        self._queue.append(each)
        self._wake.set()

    async def send(self) -> None:
        """Send queued frames and newest samples until cancelled.

        Raises:
            TimeoutError: The page takes nothing.
        """
        while True:
            await self._wake.wait()
            self._wake.clear()
            parts = [*self._queue, *self._newest.values()]
            if self._lost:
                parts.insert(0, part("lost", count=self._lost))
            self._queue.clear()
            self._newest.clear()
            self._lost = 0
            async with asyncio.timeout(STUCK_S):
                await self._socket.send_text((b"[" + b",".join(parts) + b"]").decode())

    def may_send(self) -> bool:
        """Count a received frame; returns whether the page is within its limit."""
        now_ns = self._clock.now_ns()
        earned = (now_ns - self._counted_ns) / NS_PER_S * FRAMES_PER_S
        self._counted_ns = now_ns
        self._credit = min(float(BURST), self._credit + earned) - 1.0
        return self._credit >= 0.0
