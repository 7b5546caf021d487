"""The Zenoh session: opened and closed within bounds, and all that is declared in it.

The loop owns everything here. Zenoh's threads touch nothing but the inbox.

As a router on loopback that tries to join the machine's usual router, it is reached by clients and
peers, directly and through that router, whichever came first, and stays reachable when the router
goes. One thing to know: a peer that connects to both of them gets and gives most samples twice.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from typing import Self

import zenoh
from zenoh.handlers import Callback

from yahboomd.bus.bounded import bounded
from yahboomd.bus.failures import open_failure
from yahboomd.bus.hangup import hang_up_stuck
from yahboomd.bus.inbox import DEPTH, Inbox, Lane
from yahboomd.bus.keys import full_key
from yahboomd.bus.options import BusOptions, zenoh_config
from yahboomd.bus.presence import (
    Neighbour,
    NeighbourChange,
    Neighbours,
    TokenChange,
    stamp_id,
    stamper,
)
from yahboomd.bus.publishers import BusPublisher, PriorityName
from yahboomd.bus.sender import Sender
from yahboomd.bus.services import Fallback, Handler, Pending, Service
from yahboomd.bus.subscriptions import Arrival, Subscription
from yahboomd.clock import Clock, SystemClock
from yahboomd.errors import BusError

log = logging.getLogger(__name__)

MAX_BYTES = 4096
"""The largest payload that a subscription or service takes unless told otherwise."""


class Bus:
    """A Zenoh session on a running event loop.

    Args:
        options: How the session is to be.
        clock: Stamps what arrives.
    """

    def __init__(self, options: BusOptions, *, clock: Clock | None = None) -> None:
        self.options = options
        self._clock = clock or SystemClock()
        self._session: zenoh.Session | None = None
        self._inbox: Inbox | None = None
        self._closed = True
        # Two: an e-stop's acknowledgement is not to wait behind an event for somebody who froze.
        self._answers = Sender("bus-answers")
        self._reliable = Sender("bus-reliable")
        self._services: list[Service] = []
        # A token that nobody holds on to is undeclared when it is collected.
        self._tokens: list[zenoh.LivelinessToken] = []
        self._subscriptions: list[Subscription] = []
        self._neighbours = Neighbours()
        self._watchers: list[Callable[[list[NeighbourChange]], None]] = []
        # The stamps that tell nothing of the sending: our own, and the nearest routers'.
        self._foreign_stampers = frozenset[int]()

    async def open(self) -> None:
        """Open the session; it listens from then on, and joins what it is to join by itself.

        Raises:
            BusError: It cannot be opened as configured.
        """
        config = zenoh_config(self.options)
        try:
            session = await bounded(
                lambda: zenoh.open(config),
                timeout_s=self.options.open_timeout_s,
                name="bus-open",
                late=lambda session: session.close(),
            )
        except TimeoutError as error:
            raise BusError(
                f"The Zenoh session did not open within {self.options.open_timeout_s:g} s.",
                remedy="A connect.timeout_ms of -1 in the Zenoh configuration waits for ever.",
            ) from error
        except zenoh.ZError as error:
            raise open_failure(error, self.options) from error
        self._session = session
        self._inbox = Inbox()
        self._foreign_stampers = frozenset({stamp_id(self.zid)})
        lane = self._inbox.lane(self._neighbours_changed)
        session.info.declare_transport_events_listener(
            Callback(lane.offer, indirect=False), history=True
        )

    async def close(self) -> bool:
        """Answer what is pending and close the session, within bounds; safe to call twice.

        Returns:
            Whether it is closed. Where not, a thread is left inside Zenoh, and Python's ordinary
            exit would hang or abort: end the process by ``os._exit``.
        """
        session, self._session = self._session, None
        inbox, self._inbox = self._inbox, None
        if session is None or inbox is None:
            return self._closed
        self._closed = False
        for subscription in self._subscriptions:
            subscription.close()
        tasks = [task for service in self._services for task in service.close()]
        try:
            await asyncio.gather(*tasks, return_exceptions=True)
            await bounded(
                lambda: self._close(session),
                timeout_s=self.options.close_timeout_s,
                name="bus-close",
            )
            self._closed = True
        except TimeoutError:
            log.warning(
                "The Zenoh session did not close within %g s; it is left behind",
                self.options.close_timeout_s,
            )
        except zenoh.ZError as error:
            log.warning("The Zenoh session did not close well: %s", error)
        finally:
            inbox.close(leak=not self._closed)
        return self._closed

    def _close(self, session: zenoh.Session) -> None:
        hang_up_stuck(lambda: [(link.src, link.dst) for link in session.info.links()])
        for sender in (self._answers, self._reliable):
            sender.close(self.options.close_timeout_s / 4)
        session.close()

    async def __aenter__(self) -> Self:
        await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def zid(self) -> str:
        """The session's id."""
        return str(self._opened().zid())

    @property
    def neighbours(self) -> tuple[Neighbour, ...]:
        """The sessions that this one is connected to."""
        return self._neighbours.now()

    def key(self, name: str) -> str:
        """A key in full: below the namespace, unless ``name`` begins with ``/``."""
        return full_key(self.options.namespace, name)

    def publisher(
        self,
        key: str,
        *,
        encoding: str = "",
        reliable: bool = False,
        priority: PriorityName | None = None,
        express: bool = False,
        cache: int = 0,
    ) -> BusPublisher:
        """Declare a publisher; see :class:`BusPublisher`.

        Telemetry goes as ``data_high`` by default, reliable samples as ``data`` (as answers to
        queries do), because the two must not share a priority.
        """
        return BusPublisher(
            self._opened(),
            self.key(key),
            encoding=encoding or "zenoh/bytes",
            reliable=self._reliable if reliable else None,
            priority=priority or ("data" if reliable else "data_high"),
            express=express,
            cache=cache,
        )

    def subscribe(
        self,
        key: str,
        handler: Callable[[list[Arrival]], None],
        *,
        depth: int = DEPTH,
        max_bytes: int = MAX_BYTES,
        urgent: bool = False,
        keep_oversize: bool = False,
    ) -> Subscription:
        """Have samples delivered to ``handler`` on the loop, oldest first, all pending at once.

        Args:
            key: The key, without wildcards.
            handler: Takes at most ``depth`` arrivals in a call. Where more came, the oldest were
                dropped and the first of the batch says how many.
            depth: Samples kept for it.
            max_bytes: The largest payload taken; larger ones are counted and not copied.
            urgent: Delivered before and between all that are not.
            keep_oversize: Deliver also those that are too large, without their payload, for
                keys on which any payload counts.
        """
        subscription = Subscription(
            key,
            handler,
            self._ready(),
            stamp_ns=self._stamp_ns,
            depth=depth,
            max_bytes=max_bytes,
            urgent=urgent,
            keep_oversize=keep_oversize,
        )
        subscription.declare(self._opened(), self.key(key), self._clock.now_ns)
        self._subscriptions.append(subscription)
        return subscription

    def serve(
        self,
        key: str,
        handler: Handler,
        *,
        fallback: Fallback,
        pending: int = 16,
        max_bytes: int = MAX_BYTES,
        urgent: bool = False,
        wildcards: bool = False,
        keep_oversize: bool = False,
        complete: bool = True,
    ) -> Service:
        """Answer queries on ``key``; every query gets an answer.

        Args:
            key: The key, without wildcards.
            handler: Answers on the loop, at once or as a coroutine.
            fallback: Makes the answer where the handler does not: it failed, too much is pending,
                the request is too large or was not meant for this key alone.
            pending: Queries that wait for the loop; more are answered by the fallback.
            max_bytes: The largest payload taken.
            urgent: Delivered before and between all that are not.
            wildcards: Whether a query on ``**`` and the like may reach the handler.
            keep_oversize: Hand over requests that are too large, without their payload.
            complete: Declared as complete: it alone is asked where several could answer.
        """
        inbox = self._ready()
        service = Service(
            key,
            self.key(key),
            handler,
            fallback,
            wildcards=wildcards,
            keep_oversize=keep_oversize,
            answers=self._answers,
        )
        lane: Lane[Pending] = inbox.lane(
            service.handle, depth=pending, urgent=urgent, refuse=service.refuse
        )
        now_ns = self._clock.now_ns

        def arrived(query: zenoh.Query) -> None:
            payload, attachment = query.payload, query.attachment
            size = max(
                0 if payload is None else len(payload), 0 if attachment is None else len(attachment)
            )
            lane.offer(Pending(query=query, arrived_ns=now_ns(), oversize=size > max_bytes))

        self._opened().declare_queryable(
            service.key, Callback(arrived, indirect=False), complete=complete
        )
        self._services.append(service)
        return service

    def token(self, key: str) -> zenoh.LivelinessToken:
        """Declare a liveliness token, alive as long as the session or until ``undeclare()``.

        For several holders of one key see :func:`yahboomd.bus.keys.holder_key`.
        """
        token = self._opened().liveliness().declare_token(self.key(key))
        self._tokens.append(token)
        return token

    def watch_tokens(self, pattern: str, handler: Callable[[list[TokenChange]], None]) -> None:
        """Have tokens that match ``pattern`` reported, those that exist already first.

        The session's own tokens are among them.
        """

        def deliver(batch: list[zenoh.Sample], _lost: int) -> None:
            handler(
                [
                    TokenChange(
                        key=str(sample.key_expr), present=sample.kind == zenoh.SampleKind.PUT
                    )
                    for sample in batch
                ]
            )

        lane: Lane[zenoh.Sample] = self._ready().lane(deliver, depth=1024)
        self._opened().liveliness().declare_subscriber(
            self.key(pattern), Callback(lane.offer, indirect=False), history=True
        )

    def watch_neighbours(self, handler: Callable[[list[NeighbourChange]], None]) -> None:
        """Have connections reported that are made or lost from now on."""
        self._watchers.append(handler)

    def _opened(self) -> zenoh.Session:
        if self._session is None:
            raise BusError("The Zenoh session is not open.")
        return self._session

    def _ready(self) -> Inbox:
        if self._inbox is None:
            raise BusError("The Zenoh session is not open.")
        return self._inbox

    def _stamp_ns(self, timestamp: zenoh.Timestamp | None) -> int | None:
        # Whatever comes without a stamp is stamped by the first session that stamps at all: by the
        # nearest router, or by us. Such a stamp says when a sample arrived, not when it was sent:
        # a backlog that a stalled link lets go would look fresh. (A stamp over 500 ms ahead of our
        # clock is replaced by one of ours, too.)
        if timestamp is None or stamper(timestamp) in self._foreign_stampers:
            return None
        return timestamp.get_time_as_ntp64().as_nanos()

    def _neighbours_changed(self, batch: list[zenoh.TransportEvent], _lost: int) -> None:
        if self._session is None:
            return
        changes = [
            change
            for event in batch
            if (change := self._neighbours.change(self._session, event.transport, event.kind))
        ]
        routers = {stamp_id(each.zid) for each in self.neighbours if each.kind == "router"}
        self._foreign_stampers = frozenset({stamp_id(self.zid), *routers})
        if changes:
            for watcher in self._watchers:
                watcher(changes)
