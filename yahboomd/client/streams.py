"""Receives samples: all, over a bounded buffer that keeps the newest, or the newest alone.

The daemon chooses the encoding, JSON or MessagePack; a client recognises it by the first byte. An
unreadable payload raises nothing, since another program sent it. Samples of other versions of
yahboomd can be read: unknown fields, words and shapes of values are ignored, and an unknown state
or severity is kept as text.
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Generic, TypeVar, get_args

import msgspec
from msgspec import structs
from zenoh.handlers import RingChannel

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.messages.codecs import encoding_of
from yahboomd.core.messages.native import (
    BatterySample,
    EventSample,
    ImuSample,
    PoseSample,
    ServiceReply,
    State,
    StatusSample,
    TwistSample,
    WheelsSample,
)
from yahboomd.core.program import pasteable, plain

if TYPE_CHECKING:
    from typing_extensions import Self

Message = TypeVar("Message", bound=msgspec.Struct)

STATES = frozenset[str](get_args(State))
"""The states that this version knows."""

# Also what msgspec raises for text that is no UTF-8 (a ValueError), and for brackets without end.
_BROKEN = (ValueError, RecursionError, OverflowError)

_FOR_PEOPLE: dict[type[msgspec.Struct], str] = {
    StatusSample: "why",
    EventSample: "message",
    ServiceReply: "message",
}
"""Texts for people, with commands that they paste, which any client of the bus may have written."""


def read_sample(payload: bytes, message: type[Message]) -> Message | None:
    """Decode a sample of a key's message; None if the bytes are not one.

    Args:
        payload: The bytes that arrived.
        message: The message's type, such as ``PoseSample``. Unknown fields are ignored.
    """
    encoding = encoding_of(payload)
    if encoding not in {"json", "msgpack"}:
        return None
    sample: msgspec.Struct | None
    try:
        sample = _decoder(encoding == "json", message)(payload)
    except msgspec.ValidationError:
        sample = _without_unknown(payload, encoding == "json", message)
    except _BROKEN:
        return None
    if not isinstance(sample, message):
        return None
    if (field := _FOR_PEOPLE.get(message)) is not None:
        sample = structs.replace(sample, **{field: pasteable(plain(getattr(sample, field)))})
    return sample


@cache
def _decoder(json: bool, message: type[msgspec.Struct]) -> Callable[[bytes], msgspec.Struct]:
    if json:
        return msgspec.json.Decoder(message).decode
    return msgspec.msgpack.Decoder(message).decode


def reason(status: StatusSample) -> str:
    """Why a robot may not drive, in a sentence; with the state if this version does not know it."""
    if status.state in STATES:
        return status.why
    state = pasteable(plain(status.state))
    return f"Its state is {state!r}, which this version of yahboomd does not know. {status.why}"


_GROUPS: dict[type[msgspec.Struct], dict[str, int]] = {
    StatusSample: dict.fromkeys(("board", "link", "command", "bus"), 3),
    EventSample: {"data": 0},
}
"""Fields that hold facts by name, and how deep groups of facts may be within."""


def _without_unknown(
    payload: bytes, json: bool, message: type[msgspec.Struct]
) -> msgspec.Struct | None:
    """Decode a sample without facts of an unknown shape; None if it is not such a message."""
    if message not in _GROUPS:
        return None
    try:
        fields = msgspec.json.decode(payload) if json else msgspec.msgpack.decode(payload)
        known = {
            name: _known(fields[name], depth)
            for name, depth in _GROUPS[message].items()
            if isinstance(fields.get(name), dict)
        }
        return msgspec.convert({**fields, **known}, message)
    except (*_BROKEN, AttributeError, TypeError):
        return None


def _known(facts: dict[object, object], depth: int) -> dict[object, object]:
    found: dict[object, object] = {}
    for name, value in facts.items():
        if value is None or isinstance(value, int | float | str):
            found[name] = value
        elif depth and isinstance(value, dict):
            found[name] = _known(value, depth - 1)
        elif depth and isinstance(value, list) and all(isinstance(it, str) for it in value):
            found[name] = value
    return found


MAX_BYTES = 1 << 18
"""The largest sample that a client takes: a status with every counter has some kilobytes."""

KEYS: dict[type[msgspec.Struct], str] = {
    PoseSample: keys.POSE,
    TwistSample: keys.TWIST,
    WheelsSample: keys.WHEELS,
    ImuSample: keys.IMU,
    BatterySample: keys.BATTERY,
    StatusSample: keys.STATUS,
    EventSample: keys.EVENTS,
}
"""The key of each message that a daemon publishes."""

EVENTS = 64
"""Events kept for a slow reader. Of other samples it gets the newest: queued poses grow old."""

MOTION = frozenset({PoseSample, TwistSample, WheelsSample, ImuSample})
"""Messages that come many times a second, and that control loops read."""


def key_of(message: type[msgspec.Struct]) -> str:
    """The key of a message, below the namespace.

    Raises:
        ValueError: A daemon publishes no such message.
    """
    key = KEYS.get(message)
    if key is None:
        known = ", ".join(each.__name__ for each in KEYS)
        raise ValueError(f"{message.__name__} is not published by a daemon; these are: {known}.")
    return key


def depth_of(message: type[msgspec.Struct], depth: int | None) -> int:
    """The number of samples kept for a slow reader: ``depth``, else 1, of events :data:`EVENTS`.

    Raises:
        ValueError: ``depth`` is below 1.
    """
    if depth is None:
        return EVENTS if message is EventSample else 1
    if depth < 1:
        raise ValueError(f"depth must be 1 or more, not {depth}.")
    return depth


class Newest:
    """The newest payload of a key, for a reader that looks less often than samples come.

    No Python code runs when one comes: at fifty samples a second on three keys, a callback for each
    would cost more than drawing a screen.

    Args:
        bus: An open session.
        key: The key, below the namespace.
    """

    def __init__(self, bus: Bus, key: str) -> None:
        self._ring = bus.session.declare_subscriber(bus.key(key), RingChannel(1))

    def take(self) -> bytes | None:
        """The newest payload; None if none came since the last call."""
        sample = self._ring.try_recv()
        return None if sample is None else sample.payload.to_bytes()


class NewestSamples(ABC):
    """The newest sample of each message, by name."""

    @abstractmethod
    def newest(self, message: type[Message]) -> Message | None:
        """The newest sample; None while there is none."""

    @property
    def pose(self) -> PoseSample | None:
        """The pose of the robot, in metres and radians; see :meth:`newest`."""
        return self.newest(PoseSample)

    @property
    def twist(self) -> TwistSample | None:
        """The motion of the robot, in m/s and rad/s; see :meth:`newest`."""
        return self.newest(TwistSample)

    @property
    def wheels(self) -> WheelsSample | None:
        """Counts, angles and speeds of each wheel; see :meth:`newest`."""
        return self.newest(WheelsSample)

    @property
    def imu(self) -> ImuSample | None:
        """The inertial sensor of a board that has one; see :meth:`newest`."""
        return self.newest(ImuSample)

    @property
    def battery(self) -> BatterySample | None:
        """The battery's voltage; see :meth:`newest`."""
        return self.newest(BatterySample)

    @property
    def status(self) -> StatusSample | None:
        """Health, counters, and why the robot stands; None while the daemon is away."""
        return self.newest(StatusSample)


class Samples(Generic[Message]):
    """Samples of one kind, oldest first. Made by ``AsyncRobot.samples``, which explains them.

    An asynchronous iterator for one reader; it ends when the robot is left or by :meth:`close`.

    Args:
        bus: An open session.
        message: The kind.
        depth: The length of the queue.
        taken: Called with the arrival of each sample that the reader takes, monotonic nanoseconds.

    Attributes:
        is_open: Whether more may come.
        dropped: Samples that the reader or this process was too slow for.
        unreadable: Payloads that could not be decoded.
    """

    def __init__(
        self,
        bus: Bus,
        message: type[Message],
        depth: int,
        taken: Callable[[int], None] = lambda _: None,
    ) -> None:
        self.dropped = 0
        self.unreadable = 0
        self.is_open = True
        self._message = message
        self._taken = taken
        self._kept: deque[tuple[Message, int]] = deque(maxlen=depth)
        self._came = asyncio.Event()
        self._subscription = bus.subscribe(
            key_of(message), self.receive, depth=depth, max_bytes=MAX_BYTES
        )

    def receive(self, arrivals: list[Arrival]) -> None:
        """Queue the arrived samples; called on the loop."""
        for arrival in arrivals:
            self.dropped += arrival.dropped
            sample = read_sample(arrival.payload, self._message)
            if sample is None:
                self.unreadable += 1
                continue
            self.dropped += len(self._kept) == self._kept.maxlen
            self._kept.append((sample, arrival.arrived_ns))
        self._came.set()

    def close(self) -> None:
        """End it; samples that are already queued can still be read."""
        if self.is_open:
            self.is_open = False
            self._subscription.close()
            self._came.set()

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Message:
        while not self._kept:
            if not self.is_open:
                raise StopAsyncIteration
            self._came.clear()
            await self._came.wait()
        sample, arrived_ns = self._kept.popleft()
        self._taken(arrived_ns)
        return sample
