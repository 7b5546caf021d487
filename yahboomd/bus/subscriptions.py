"""Samples in: from a declared subscriber, through a lane of the inbox, to a handler on the loop.

As a rule a callback puts each sample into the lane. That is the fastest way for one sample, and no
way for a flood: Zenoh reads all connections in two threads, each sample costs a turn at Python's
interpreter lock, and past some 50,000 a second (two cores) an e-stop of somebody else's waited
300 ms behind them. So while more comes than any command source sends, the samples go into a ring of
Zenoh's own, where the newest stay and no Python runs, and the loop takes from it at its own pace;
the e-stop then took 4 ms.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import TypeAlias

import msgspec
import zenoh
from zenoh.handlers import Callback, Handler, RingChannel

from yahboomd.bus.inbox import Inbox, Lane

log = logging.getLogger(__name__)

FLOOD = 256
"""Samples within a window that make a flood: more than a stall of some seconds leaves behind at
50 Hz, and a tenth of what a flood is made of."""

WINDOW_NS = 100_000_000

RING = 32
"""Samples kept of a flood between two looks at it."""

LOOK_S = 0.01
"""Between two looks. A control period of 20 ms still finds the newest command."""

QUIET = 10
"""Fewer samples than this in a look are no flood any more (1 kHz) ..."""

QUIET_LOOKS = 50
"""... once so many looks in a row have found no more."""

Received: TypeAlias = tuple[zenoh.Sample | None, int]
"""A sample and when it arrived; None stands for one that was too large."""


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """A sample as it arrived.

    Attributes:
        key: The key that was subscribed to, as the subscriber wrote it (below the namespace).
        payload: Its bytes.
        encoding: What the sender says that they are, such as ``application/json``; no authority.
        stamp_ns: When it was sent, as the sender's Zenoh session says; Unix nanoseconds of *its*
            clock. None where nobody stamped it before it reached the nearest router or us.
        arrived_ns: When it arrived here; monotonic nanoseconds.
        dropped: Samples of this subscription lost since the arrival before this one, because more
            came than the loop took.
        oversize: More bytes than the subscription takes; ``payload`` is empty then. Only a
            subscription with ``keep_oversize`` sees such a sample at all.
        attachment: The sender's attachment, where it has one of no more bytes than the payload may.
    """

    key: str
    payload: bytes
    encoding: str
    stamp_ns: int | None
    arrived_ns: int
    dropped: int = 0
    oversize: bool = False
    attachment: bytes | None = None


class Subscription:
    """A subscriber on one key. Made by ``Bus.subscribe``, which explains the arguments.

    Args:
        name: The key as declared, below the namespace.
        handler: Takes what arrived, on the loop.
        inbox: Brings it there.
        stamp_ns: When a sample was sent, as far as its timestamp tells.
        depth: Samples kept for the handler.
        max_bytes: The largest payload taken.
        urgent: Before all that is not.
        keep_oversize: Deliver also what is too large, without its payload.
    """

    def __init__(
        self,
        name: str,
        handler: Callable[[list[Arrival]], None],
        inbox: Inbox,
        *,
        stamp_ns: Callable[[zenoh.Timestamp | None], int | None],
        depth: int,
        max_bytes: int,
        urgent: bool,
        keep_oversize: bool,
    ) -> None:
        self.name = name
        self._handler = handler
        self._inbox = inbox
        self._stamp_ns = stamp_ns
        self._max_bytes = max_bytes
        self._keep_oversize = keep_oversize
        self._lane: Lane[Received] = inbox.lane(self._deliver, depth=depth, urgent=urgent)
        self.counters = self._lane.counters
        self._declare: Callable[[], zenoh.Subscriber[None]] | None = None
        self._declare_ring: Callable[[], zenoh.Subscriber[Handler[zenoh.Sample]]] | None = None
        self._now_ns: Callable[[], int]
        self._direct: zenoh.Subscriber[None] | None = None
        self._ring: zenoh.Subscriber[Handler[zenoh.Sample]] | None = None
        self._look: asyncio.TimerHandle | None = None
        self._window_began_ns = 0
        self._in_window = 0
        self._quiet_looks = 0

    def declare(self, session: zenoh.Session, key: str, now_ns: Callable[[], int]) -> None:
        """Begin: ``key`` is in full, ``now_ns`` stamps what arrives."""
        lane, max_bytes, keep_oversize = self._lane, self._max_bytes, self._keep_oversize

        def arrived(sample: zenoh.Sample) -> None:
            # Payload and encoding are read on the loop: what a flood loses was never copied.
            if len(sample.payload) <= max_bytes:
                lane.offer((sample, now_ns()))
            elif keep_oversize:
                lane.offer((None, now_ns()))
            else:
                lane.too_large()

        self._now_ns = now_ns
        self._declare = lambda: session.declare_subscriber(key, Callback(arrived, indirect=False))
        self._declare_ring = lambda: session.declare_subscriber(key, RingChannel(RING))
        self._direct = self._declare()

    @property
    def flooded(self) -> bool:
        """Whether more comes than is taken sample by sample."""
        return self._ring is not None

    def close(self) -> None:
        """End it; what has not been delivered is forgotten."""
        if self._look is not None:
            self._look.cancel()
        if self._direct is not None:
            self._direct.undeclare()
        if self._ring is not None:
            self._ring.undeclare()
        self._direct = self._ring = None
        self._inbox.remove(self._lane)

    def _deliver(self, batch: list[Received], lost: int) -> None:
        now_ns = batch[-1][1]
        if now_ns - self._window_began_ns > WINDOW_NS:
            self._window_began_ns, self._in_window = now_ns, 0
        self._in_window += len(batch) + lost
        if self._in_window > FLOOD:
            self._take_from_ring()
        self._hand_over(batch, lost)

    def _hand_over(self, batch: list[Received], lost: int) -> None:
        arrivals = [self._arrival(received, 0) for received in batch[1:]]
        self._handler([self._arrival(batch[0], lost), *arrivals])

    def _take_from_ring(self) -> None:
        if self._direct is None or self._declare_ring is None:
            return
        log.warning(
            "%s is flooded: the newest %d samples of every %g ms count until it ends",
            *(self.name, RING, LOOK_S * 1000),
        )
        self.counters.floods += 1
        # In this order none is missed; one that comes both ways says the same twice.
        self._ring = self._declare_ring()
        self._direct.undeclare()
        self._direct = None
        self._quiet_looks = 0
        self._look = asyncio.get_running_loop().call_later(LOOK_S, self._look_into_ring)

    def _look_into_ring(self) -> None:
        self._look = None
        samples = self._drain_ring()
        self._quiet_looks = self._quiet_looks + 1 if len(samples) < QUIET else 0
        if self._quiet_looks >= QUIET_LOOKS and self._declare is not None:
            log.info("%s is no longer flooded", self.name)
            self._direct = self._declare()
            samples += self._drain_ring()
            if self._ring is not None:
                self._ring.undeclare()
            self._ring = None
        else:
            self._look = asyncio.get_running_loop().call_later(LOOK_S, self._look_into_ring)
        self._take(samples)

    def _drain_ring(self) -> list[zenoh.Sample]:
        samples = list[zenoh.Sample]()
        while self._ring is not None and len(samples) < RING:
            sample = self._ring.try_recv()
            if sample is None:
                break
            samples.append(sample)
        return samples

    def _take(self, samples: list[zenoh.Sample]) -> None:
        now_ns = self._now_ns()
        batch = list[Received]()
        for sample in samples:
            self.counters.received += 1
            fits = len(sample.payload) <= self._max_bytes
            if not fits:
                self.counters.oversize += 1
            if fits or self._keep_oversize:
                batch.append((sample if fits else None, now_ns))
        if not batch:
            return
        # How many a full ring has lost nobody knows: one at least.
        lost = int(len(samples) >= RING)
        self.counters.dropped += lost
        self.counters.delivered += len(batch)
        self.counters.batches += 1
        self._hand_over(batch, lost)

    def _arrival(self, received: Received, dropped: int) -> Arrival:
        sample, arrived_ns = received
        if sample is None:
            return Arrival(
                key=self.name,
                payload=b"",
                encoding="",
                stamp_ns=None,
                arrived_ns=arrived_ns,
                dropped=dropped,
                oversize=True,
            )
        attachment = sample.attachment
        if attachment is not None and len(attachment) > self._max_bytes:
            attachment = None
        return Arrival(
            key=self.name,
            payload=sample.payload.to_bytes(),
            encoding=str(sample.encoding),
            stamp_ns=self._stamp_ns(sample.timestamp),
            arrived_ns=arrived_ns,
            dropped=dropped,
            attachment=None if attachment is None else attachment.to_bytes(),
        )
