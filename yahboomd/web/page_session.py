"""One page: the frames that it sends and gets, and its queue with their limits.

Frames are JSON: the page's have one object each, ours a list.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, TypeAlias

import msgspec
from msgspec import Meta
from starlette.websockets import WebSocket

from yahboomd.core.clock import Clock
from yahboomd.core.model import NS_PER_S
from yahboomd.web.phone_sessions import PhoneSession
from yahboomd.web.session_files import Role

MAX_BYTES = 2048
"""The most bytes of a frame, and of the body of a request."""

_Place = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Speed = Annotated[float, Meta(gt=0.0, le=1000.0)]
_Number = Annotated[int, Meta(ge=0, le=1 << 53)]


class Drive(msgspec.Struct, frozen=True, tag="drive"):
    """A velocity, in m/s and rad/s, and the last beat that the page received."""

    beat: _Number
    vx: float
    vy: float
    wz: float


class Go(msgspec.Struct, frozen=True, tag="go"):
    """A place of the map is held: the robot goes there, or turns to look there.

    Attributes:
        x: Metres, in the odometry frame.
        y: Metres.
        speed_m_s: The fastest that the page's speed limit allows.
        turn_rad_s: The same for turning.
    """

    beat: _Number
    x: _Place
    y: _Place
    turn: bool
    speed_m_s: _Speed
    turn_rad_s: _Speed

    is_zero: ClassVar[bool] = False


class Control(msgspec.Struct, frozen=True, tag="control"):
    """The page wants control, or gives it back.

    Attributes:
        if_free: It came with a touch: control is not taken from another page.
    """

    want: bool
    if_free: bool = False


class RequestFrame(msgspec.Struct, frozen=True, tag="request"):
    """A request of the page, which is answered."""

    id: _Number
    do: str
    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0


class StopFrame(msgspec.Struct, frozen=True, tag="estop"):
    """The page engages the emergency stop."""

    id: _Number = 0


class Seen(msgspec.Struct, frozen=True, tag="seen"):
    """The last beat that a page without commands received."""

    beat: _Number


class Tool(msgspec.Struct, frozen=True, tag="tool"):
    """The page uses a tool, such as the calibration; it is answered."""

    id: _Number
    do: str
    args: dict[str, Any] = {}


class HoldFrame(msgspec.Struct, frozen=True, tag="hold"):
    """The button of a calibration is held, for the movement of this question."""

    beat: _Number
    question: str


class LetGo(msgspec.Struct, frozen=True, tag="let_go"):
    """The button of a calibration was let go."""


PageFrame: TypeAlias = (
    Drive | Go | Control | RequestFrame | StopFrame | Seen | Tool | HoldFrame | LetGo
)

_decoder: msgspec.json.Decoder[PageFrame] = msgspec.json.Decoder(PageFrame)
_encoder = msgspec.json.Encoder()


def read_frame(text: str) -> PageFrame | None:
    """Decode a page's frame; None if it is not a valid one."""
    try:
        return _decoder.decode(text)
    except (ValueError, RecursionError):
        return None


def part(kind: str, **fields: object) -> bytes:
    """One object of a frame to pages."""
    return _encoder.encode({"type": kind, **fields})


def sample_part(kind: str, sample: msgspec.Struct) -> bytes:
    """A sample as an object of a frame to pages."""
    return _encoder.encode({"type": kind, "sample": sample})


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

    def answer(self, number: int, *, ok: bool, text: str, data: object = None) -> None:
        """Answer its request of this number."""
        self.queue(part("answer", id=number, ok=ok, text=text, data=data))

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
