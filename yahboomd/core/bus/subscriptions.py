"""Delivers samples: from a subscriber, through a lane of the inbox, to a handler on the loop.

As a rule a callback puts each sample into the lane. That is the fastest way for one sample, but not
for a flood: Zenoh reads all connections in two threads, each sample takes Python's interpreter lock
once, and beyond some 50,000 a second (two cores) an e-stop of another client waited 300 ms behind
them. So while more comes than any command source sends, the samples go into a ring of Zenoh's own,
which keeps the newest and runs no Python, and the loop takes from it at its own pace; the e-stop
then took 4 ms.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable
from typing import TypeAlias

import msgspec
import zenoh
from zenoh.handlers import Callback, Handler, RingChannel

from yahboomd.core.bus.inbox import Inbox, SampleLane, carried_bytes

log = logging.getLogger(__name__)

FLOOD = 256
"""Samples within a window that make a flood: more than a stall of some seconds leaves behind at
50 Hz, and a tenth of a true flood."""

WINDOW_NS = 100_000_000

RING = 4
"""Samples kept of a flood between two looks at it. Zenoh keeps them whole, so their small number
bounds the memory that a flood of the largest messages can hold."""

LOOK_S = 0.005
"""The time between two looks. A control period of 20 ms still finds the newest command."""

QUIET_LOOKS = 100
"""The flood is over after this many looks in a row without a full ring (less than 800 Hz)."""

Received: TypeAlias = tuple[bytes | None, zenoh.Timestamp | None, bytes | None, int]
"""Payload, stamp and attachment of a sample, and when it arrived; no payload stands for one that
was too large."""


class Arrival(msgspec.Struct, frozen=True, kw_only=True):
    """A sample as it arrived.

    Attributes:
        key: The key of the subscription, as the subscriber wrote it (below the namespace).
        payload: Its bytes. (The Encoding that the sender names is not trusted, and not read.)
        stamp_ns: When it was sent, by the sender's Zenoh session; Unix nanoseconds of *its*
            clock. None if it had no stamp before it reached the nearest router or us.
        arrived_ns: When it arrived here; monotonic nanoseconds.
        dropped: Samples of this subscription lost since the arrival before this one, because more
            came than the loop took.
        oversize: Payload and attachment exceed the limit of the subscription; ``payload`` is
            empty then. Only a subscription with ``keep_oversize`` sees such a sample at all.
        attachment: The sender's attachment, if there is one.
    """

    key: str
    payload: bytes
    stamp_ns: int | None
    arrived_ns: int
    dropped: int = 0
    oversize: bool = False
    attachment: bytes | None = None


class Subscription:
    """A subscriber on one key. Made by ``Bus.subscribe``, which explains the arguments.

    Args:
        name: The key as declared, below the namespace.
        key: The key in full.
        stamp_ns: When a sample was sent, as far as its timestamp shows.
    """

    def __init__(
        self,
        name: str,
        key: str,
        handler: Callable[[list[Arrival]], None],
        *,
        inbox: Inbox,
        now_ns: Callable[[], int],
        stamp_ns: Callable[[zenoh.Timestamp | None], int | None],
        wall_ns: Callable[[], int],
        depth: int,
        max_bytes: int,
        keep_oversize: bool,
        gather_s: float = 0.0,
    ) -> None:
        self.name = name
        self.key = key
        self._handler = handler
        self._inbox = inbox
        self._now_ns = now_ns
        self._stamp_ns = stamp_ns
        self._wall_ns = wall_ns
        self._gather_s = gather_s
        self._depth = depth
        self._max_bytes = max_bytes
        self._keep_oversize = keep_oversize
        self._lane: SampleLane[Received] = inbox.lane(self._deliver, depth=depth)
        self.counters = self._lane.counters
        self._open = True
        self._sessions: list[zenoh.Session] = []
        self._direct: list[zenoh.Subscriber[None]] = []
        self._rings: list[zenoh.Subscriber[Handler[zenoh.Sample]]] = []
        self._look: asyncio.TimerHandle | None = None
        self._gathered_ns = now_ns()
        self._window_began_ns = 0
        self._in_window = 0
        self._quiet_looks = 0

    def attach(self, session: zenoh.Session) -> None:
        if not self._open:
            return
        self._sessions.append(session)
        if self._gather_s:
            self._rings.append(session.declare_subscriber(self.key, RingChannel(self._depth)))
            if self._look is None:
                self._gather()
        elif self.flooded:
            self._rings.append(session.declare_subscriber(self.key, RingChannel(RING)))
        else:
            self._direct.append(self._listen(session))

    @property
    def closed(self) -> bool:
        return not self._open

    @property
    def flooded(self) -> bool:
        return bool(self._rings)

    def close(self) -> None:
        """End it; undelivered samples are discarded."""
        self._open = False
        if self._look is not None:
            self._look.cancel()
        self._sessions.clear()
        self._let_go()
        self._inbox.remove(self._lane)

    def _listen(self, session: zenoh.Session) -> zenoh.Subscriber[None]:
        lane, max_bytes, keep_oversize = self._lane, self._max_bytes, self._keep_oversize
        now_ns, wake = self._now_ns, self._inbox.wake

        def arrived(sample: zenoh.Sample) -> None:
            at_ns = now_ns()
            if carried_bytes(sample) <= max_bytes:
                # The loop takes longer to wake than this thread to copy.
                wake()
                lane.offer(_copied(sample, at_ns))
            elif keep_oversize:
                lane.offer((None, None, None, at_ns))
            else:
                lane.too_large()

        return session.declare_subscriber(self.key, Callback(arrived, indirect=False))

    def _let_go(self) -> None:
        for direct in self._direct:
            direct.undeclare()
        for ring in self._rings:
            ring.undeclare()
        self._direct, self._rings = [], []

    def _deliver(self, batch: list[Received], lost: int) -> None:
        now_ns = batch[-1][3]
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
        if self.flooded or not self._sessions:
            return
        log.warning(
            "%s is flooded: the newest %d samples of every %g ms count until it ends",
            *(self.name, RING, LOOK_S * 1000),
        )
        self.counters.floods += 1
        # In this order none is missed; one that comes both ways is delivered twice.
        rings = [
            session.declare_subscriber(self.key, RingChannel(RING)) for session in self._sessions
        ]
        self._let_go()
        self._rings = rings
        self._quiet_looks = 0
        self._look = asyncio.get_running_loop().call_later(LOOK_S, self._look_into_rings)

    def _look_into_rings(self) -> None:
        batches = [self._drain(ring) for ring in self._rings]
        quiet = all(taken < RING for _, taken in batches)
        self._quiet_looks = self._quiet_looks + 1 if quiet else 0
        if self._quiet_looks >= QUIET_LOOKS:
            log.info("%s is no longer flooded", self.name)
            self._look = None
            direct = [self._listen(session) for session in self._sessions]
            batches += [self._drain(ring) for ring in self._rings]
            self._let_go()
            self._direct = direct
        else:
            self._look = asyncio.get_running_loop().call_later(LOOK_S, self._look_into_rings)
        for batch, taken in batches:
            # A full ring does not count its losses: there is at least one.
            self._deliver_drained(batch, lost=int(taken >= RING))

    def _gather(self) -> None:
        """Deliver the gathered samples; all subscriptions of a loop at the same time."""
        loop = asyncio.get_running_loop()
        turn = math.floor(loop.time() / self._gather_s) + 1
        self._look = loop.call_at(turn * self._gather_s, self._gather)
        before_ns, self._gathered_ns = self._gathered_ns, self._now_ns()
        for ring in self._rings:
            batch, taken = self._drain(ring, self._depth)
            self._deliver_drained(
                [
                    (payload, stamp, attached, at_ns - self._age_ns(stamp, at_ns - before_ns))
                    for payload, stamp, attached, at_ns in batch
                ],
                lost=int(taken >= self._depth),
            )

    def _age_ns(self, stamp: zenoh.Timestamp | None, most_ns: int) -> int:
        """How long ago a gathered sample came: the age of its stamp at the nearest router.

        A stamp from long before the gathering began is of another clock, or took a slow way.
        """
        if stamp is None:
            return 0
        age_ns = self._wall_ns() - stamp.get_time_as_ntp64().as_nanos()
        return min(age_ns, most_ns) if 0 <= age_ns <= 2 * most_ns else 0

    def _drain(
        self, ring: zenoh.Subscriber[Handler[zenoh.Sample]], most: int = RING
    ) -> tuple[list[Received], int]:
        """Take the samples of a ring, and their number; large ones are discarded at once."""
        now_ns = self._now_ns()
        batch = list[Received]()
        taken = 0
        while taken < most and (sample := ring.try_recv()) is not None:
            taken += 1
            if carried_bytes(sample) <= self._max_bytes:
                batch.append(_copied(sample, now_ns))
            else:
                self.counters.oversize += 1
                if self._keep_oversize:
                    batch.append((None, None, None, now_ns))
        self.counters.received += taken
        return batch, taken

    def _deliver_drained(self, batch: list[Received], *, lost: int) -> None:
        if not batch:
            return
        self.counters.dropped += lost
        self._hand_over(batch, lost)

    def _arrival(self, received: Received, dropped: int) -> Arrival:
        payload, timestamp, attachment, arrived_ns = received
        return Arrival(
            key=self.name,
            payload=payload or b"",
            stamp_ns=self._stamp_ns(timestamp),
            arrived_ns=arrived_ns,
            dropped=dropped,
            oversize=payload is None,
            attachment=attachment,
        )


def _copied(sample: zenoh.Sample, at_ns: int) -> Received:
    attachment = sample.attachment
    return (
        sample.payload.to_bytes(),
        sample.timestamp,
        None if attachment is None else attachment.to_bytes(),
        at_ns,
    )
