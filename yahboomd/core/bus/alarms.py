"""Keys on which every sample and every query counts, unless it is recognised as harmless.

The decision is made in Zenoh's thread as the payload arrives, and only the decision is kept. So a
flood of harmless payloads cannot push an alarm out of a queue, and an alarm never waits for the
loop to read earlier payloads. A payload that is too long to be harmless raises the alarm unread.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import zenoh
from zenoh.handlers import Callback

from yahboomd.core.bus.inbox import MAX_BYTES, Inbox, SampleLane

READ_BYTES = 64
"""The longest payload that is read; the longest honest harmless one has about 30 bytes."""

Harmless: TypeAlias = Callable[[bytes], bool]
"""Whether a payload raises no alarm. Pure and quick: it is called in Zenoh's threads."""


def is_unread(carrier: zenoh.Sample | zenoh.Query) -> bool:
    """Whether it is too large to be read, and raises an alarm unread."""
    # Each look at a part of a message costs as much as reading a short payload does.
    payload, attachment = carrier.payload, carrier.attachment
    size = 0 if payload is None else len(payload)
    if size > READ_BYTES:
        return True
    return attachment is not None and size + len(attachment) > MAX_BYTES


def raises_alarm(carrier: zenoh.Sample | zenoh.Query, harmless: Harmless) -> bool:
    """Whether a sample raises an alarm; an empty or unreadable one does."""
    payload = carrier.payload
    if payload is None or is_unread(carrier):
        return True
    try:
        return not harmless(payload.to_bytes())
    except Exception:  # noqa: BLE001 - raised in Zenoh's thread it would lose the alarm
        return True


def is_named(key: str, selector: str) -> bool:
    """Whether a query asks for an alarm's key, and not for everything.

    Wildcards may stand before the last part, so that one query stops several robots. The last part
    must be written out: programs that list a network ask for ``**`` or ``yahboomd/*``. A key of
    ROS 2 (``::dds_::``) ends in a type that many keys share, and needs its full name.

    Args:
        key: As declared, below the namespace.
    """
    return "::dds_::" not in key and selector.rpartition("/")[2] == key.rpartition("/")[2]


class AlarmSubscriber:
    """A subscriber to one such key. Made by ``Bus.alarm``, which explains the arguments.

    Unlike a subscription's, its samples never go into a ring of Zenoh's, which drops samples unread
    when it is full.
    """

    def __init__(
        self,
        key: str,
        raised: Callable[[int, int], None],
        ignored: Callable[[int], None],
        *,
        harmless: Harmless,
        idle: Callable[[int], None],
        asks_nothing: Harmless,
        inbox: Inbox,
    ) -> None:
        self.key = key
        self._harmless = harmless
        self._asks_nothing = asks_nothing
        # An entry is true if its payload went unread. A full lane merges its entries: one that is
        # left raises the alarm for all, and their number is kept.
        self._alarms: SampleLane[bool] = inbox.lane(
            lambda batch, merged: raised(len(batch) + merged, sum(batch)), urgent=True
        )
        self._ignored = _counting(inbox, ignored)
        self._idle = _counting(inbox, idle)

    def attach(self, session: zenoh.Session) -> None:
        alarms, ignored, idle = self._alarms, self._ignored, self._idle
        harmless, asks_nothing = self._harmless, self._asks_nothing

        def silent(payload: bytes) -> bool:
            return harmless(payload) or asks_nothing(payload)

        def arrived(sample: zenoh.Sample) -> None:
            if raises_alarm(sample, silent):
                alarms.offer(is_unread(sample))
            elif asks_nothing(sample.payload.to_bytes()):
                idle.offer(None)
            else:
                ignored.offer(None)

        session.declare_subscriber(self.key, Callback(arrived, indirect=False))


def _counting(inbox: Inbox, count: Callable[[int], None]) -> SampleLane[None]:
    return inbox.lane(lambda batch, merged: count(len(batch) + merged), depth=1)
