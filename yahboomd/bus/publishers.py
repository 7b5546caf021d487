"""Samples out: one declared publisher per key, whose ``put`` neither blocks nor raises.

Telemetry is dropped where a subscriber's connection is full: with congestion control BLOCK a
subscriber that froze held the caller for five seconds. ``reliable`` samples, small and rare, are
put by a thread that may wait.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Literal, TypeAlias

import msgspec
import zenoh
import zenoh.ext
from zenoh.handlers import Callback

from yahboomd.bus.sender import Sender

log = logging.getLogger(__name__)

PriorityName: TypeAlias = Literal[
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
]

PRIORITIES: dict[PriorityName, zenoh.Priority] = {
    "real_time": zenoh.Priority.REAL_TIME,
    "interactive_high": zenoh.Priority.INTERACTIVE_HIGH,
    "interactive_low": zenoh.Priority.INTERACTIVE_LOW,
    "data_high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "data_low": zenoh.Priority.DATA_LOW,
    "background": zenoh.Priority.BACKGROUND,
}


class PublisherCounters(msgspec.Struct, kw_only=True):
    """Samples given to Zenoh, and those that were not taken."""

    puts: int = 0
    errors: int = 0


class BusPublisher:
    """A publisher on one key. Made by ``Bus.publisher``.

    Args:
        session: The open session.
        key: The key in full.
        encoding: What the samples are, such as ``application/json;pose``.
        reliable: Puts the samples and may wait for it, rather than drop them where a connection
            is full; None for telemetry.
        priority: Which samples go first when they queue. Samples that are dropped and samples that
            are waited for must differ in it: they share a queue for each priority and connection,
            and who waits in it holds up all others.
        express: Send each sample by itself at once, instead of in a batch with its neighbours.
        cache: Samples kept for subscribers that come later (``tf_static``: 1); none for 0.
    """

    def __init__(
        self,
        session: zenoh.Session,
        key: str,
        *,
        encoding: str,
        reliable: Sender | None,
        priority: PriorityName,
        express: bool,
        cache: int,
    ) -> None:
        self.key = key
        self.counters = PublisherCounters()
        self._reliable = reliable
        self._publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher
        self._undeclare: Callable[[], None]
        congestion = zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP
        if cache:
            self._publisher = zenoh.ext.declare_advanced_publisher(
                session,
                key,
                encoding=encoding,
                congestion_control=congestion,
                priority=PRIORITIES[priority],
                express=express,
                cache=zenoh.ext.CacheConfig(cache),
                # Subscribers that look for late publishers find this one by its token.
                publisher_detection=True,
            )
            self._undeclare = self._publisher.undeclare
            # Who comes later gets what was put before: there is always somebody to put it for.
            self._matching = True
        else:
            self._publisher = session.declare_publisher(
                key,
                encoding=encoding,
                congestion_control=congestion,
                priority=PRIORITIES[priority],
                express=express,
            )
            self._undeclare = self._publisher.undeclare
            self._matching = False
            self._watch_matching(self._publisher)

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody listens: without one, encoding a sample is work for nothing."""
        return self._matching

    def put(self, payload: bytes, attachment: bytes | None = None) -> bool:
        """Publish.

        Returns:
            Whether the sample was taken. Zenoh may still drop it where a connection is full.
        """
        if self._reliable is None:
            return self._put(payload, attachment)
        if self._reliable.send(lambda: self._put(payload, attachment)):
            return True
        self.counters.errors += 1
        return False

    def close(self) -> None:
        """Tell the others that nothing more comes."""
        try:
            self._undeclare()
        except zenoh.ZError as error:
            log.debug("Publisher %s: %s", self.key, error)

    def _put(self, payload: bytes, attachment: bytes | None) -> bool:
        try:
            self._publisher.put(payload, attachment=attachment)
        except zenoh.ZError as error:
            self.counters.errors += 1
            # A closed session fails 50 times a second, for ever: the first time tells it.
            if self.counters.errors == 1:
                log.warning("Samples on %s are lost: %s", self.key, error)
            return False
        self.counters.puts += 1
        return True

    def _watch_matching(self, publisher: zenoh.Publisher) -> None:
        def changed(status: zenoh.MatchingStatus) -> None:
            self._matching = status.matching

        # 2 us a look at the status, nothing for a listener; it tells changes only, so the state
        # to begin with is asked for after it is there.
        callback: Callable[[zenoh.MatchingStatus], None] = Callback(changed, indirect=False)
        publisher.declare_matching_listener(callback)
        # The stubs call this a bool, which is what it holds.
        status: object = publisher.matching_status
        self._matching = self._matching or bool(getattr(status, "matching", status))
