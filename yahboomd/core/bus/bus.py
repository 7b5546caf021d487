"""The bus: opened and closed in bounded time, with all declarations on it.

The loop owns everything here. Zenoh's threads touch nothing but the inbox.

By default it has two Zenoh sessions, and makes every declaration in both:
a router on loopback, to which clients and peers on the machine connect, and a client of the
machine's usual router, as soon as that is there (:mod:`.zenoh_sessions`). An application that
connects to both receives and sends every sample twice; it should connect to one.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Protocol, TypeVar

import zenoh

from yahboomd.core.bus.alarms import AlarmSubscriber, Harmless
from yahboomd.core.bus.blocking import Sender, bounded
from yahboomd.core.bus.inbox import DEPTH, MAX_BYTES, Inbox
from yahboomd.core.bus.keys import full_key
from yahboomd.core.bus.options import BusOptions, zenoh_config
from yahboomd.core.bus.presence import (
    Neighbour,
    NeighbourChange,
    Neighbours,
    Token,
    TokenChange,
    TokenWatch,
)
from yahboomd.core.bus.publishers import BusPublisher, PriorityName
from yahboomd.core.bus.services import Answering, Fallback, Handler, Service
from yahboomd.core.bus.subscriptions import Arrival, Subscription
from yahboomd.core.bus.zenoh_sessions import hang_up_stuck, open_failure, open_uplink
from yahboomd.core.clock import Clock, SystemClock
from yahboomd.core.errors import BusError

log = logging.getLogger(__name__)

LARGE = 2
"""Oversize queries that are kept at once, to be refused with a reason."""


class Declared(Protocol):
    """Something that is declared in every session."""

    def attach(self, session: zenoh.Session) -> None:
        """Declare it in this session too."""


Declaration = TypeVar("Declaration", bound=Declared)


class Bus:
    """The robot's place on the bus, on a running event loop."""

    def __init__(
        self, options: BusOptions, *, clock: Clock | None = None, aside: bool = False
    ) -> None:
        self.options = options
        self._publishing = Sender("bus-samples") if aside else None
        self._clock = clock or SystemClock()
        self._sessions: list[zenoh.Session] = []
        self._inbox: Inbox | None = None
        self._uplink: asyncio.Task[None] | None = None
        self._closed = True
        # Two, so that an e-stop's acknowledgement does not wait behind an answer to a frozen
        # application.
        self._answering = Answering(
            answers=Sender("bus-answers"),
            acknowledgements=Sender("bus-acknowledgements"),
            large=threading.Semaphore(LARGE),
        )
        self._neighbours = Neighbours()
        self._declared: list[Declared] = [self._neighbours]

    async def open(self) -> None:
        """Open the session; it listens from then on, and joins its router by itself.

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
                remedy="In the Zenoh configuration a connect.timeout_ms of -1 waits for ever, and "
                "so does a certificate or key that is a pipe.",
            ) from error
        except zenoh.ZError as error:
            raise open_failure(error, self.options) from error
        self._inbox = Inbox()
        self._neighbours.begin(self._inbox)
        self._attach(session)
        if self.options.has_uplink:
            self._uplink = asyncio.create_task(self._join(), name="bus-uplink")

    async def close(self) -> bool:
        """Answer pending requests and close the sessions, in bounded time; safe to call twice.

        Returns:
            Whether they are closed. If not, a thread is left inside Zenoh, and Python's ordinary
            exit would hang or abort: end the process by ``os._exit``.
        """
        inbox, self._inbox = self._inbox, None
        if inbox is None:
            return self._closed
        self._closed = False
        try:
            if self._uplink is not None:
                self._uplink.cancel()
                await asyncio.gather(self._uplink, return_exceptions=True)
            for each in self._declared:
                if isinstance(each, Subscription):
                    each.close()
            tasks = [
                task
                for each in self._declared
                if isinstance(each, Service)
                for task in each.close()
            ]
            await asyncio.gather(*tasks, return_exceptions=True)
            sessions, self._sessions = self._sessions, []
            await bounded(
                lambda: self._close(sessions),
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

    def _close(self, sessions: list[zenoh.Session]) -> None:
        hang_up_stuck(
            lambda: [(link.src, link.dst) for session in sessions for link in session.info.links()]
        )
        answering = self._answering
        for sender in (answering.acknowledgements, self._publishing, answering.answers):
            if sender is not None:
                sender.close(self.options.close_timeout_s / 6)
        for session in sessions:
            session.close()

    async def _join(self) -> None:
        session = await open_uplink(self.options)
        try:
            self._attach(session)
        except zenoh.ZError:
            log.exception("The router at %s cannot be used", ", ".join(self.options.connect))

    def _attach(self, session: zenoh.Session) -> None:
        self._sessions.append(session)
        for each in self._declared:
            each.attach(session)

    def declare(self, declaration: Declaration) -> Declaration:
        """Declare something in every session, now and as soon as it is open."""
        # A client subscribes repeatedly: forget its closed subscriptions.
        self._declared = [
            each for each in self._declared if not (isinstance(each, Subscription) and each.closed)
        ]
        for session in self._sessions:
            declaration.attach(session)
        self._declared.append(declaration)
        return declaration

    async def __aenter__(self) -> Bus:  # noqa: PYI034 - Self is of 3.11
        await self.open()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    @property
    def zid(self) -> str:
        self.inbox()
        return str(self._sessions[0].zid())

    @property
    def neighbours(self) -> tuple[Neighbour, ...]:
        return self._neighbours.now()

    def status_values(self) -> dict[str, int]:
        return _summed_counters(self._declared)

    def key(self, name: str) -> str:
        """A key in full: below the namespace, unless ``name`` begins with ``/``."""
        return full_key(self.options.namespace, name)

    def publisher(
        self,
        key: str,
        *,
        encoding: str = "",
        priority: PriorityName = "data_high",
        express: bool = False,
        cache: int = 0,
    ) -> BusPublisher:
        self.inbox()
        return self.declare(
            BusPublisher(
                self.key(key),
                encoding=encoding or "zenoh/bytes",
                priority=priority,
                express=express,
                cache=cache,
                sender=self._publishing,
            )
        )

    def subscribe(
        self,
        key: str,
        handler: Callable[[list[Arrival]], None],
        *,
        depth: int = DEPTH,
        max_bytes: int = MAX_BYTES,
        keep_oversize: bool = False,
        gather_s: float = 0.0,
    ) -> Subscription:
        """Deliver samples to ``handler`` on the loop, oldest first, all pending ones at once.

        Args:
            key: The key, without wildcards.
            handler: Takes at most ``depth`` arrivals in a call. If more came, the oldest were
                dropped, and the first of the batch has their number.
            depth: Samples kept for it.
            max_bytes: The most that payload and attachment may have together; larger samples are
                counted and not kept.
            keep_oversize: Deliver oversize samples as well, without their payload.
            gather_s: Deliver only once in this time, for half of the work: no Python runs when a
                sample comes. Its stamp is then its time of arrival, if that is possible, and
                ``depth`` samples may come in between.
        """
        return self.declare(
            Subscription(
                key,
                self.key(key),
                handler,
                inbox=self.inbox(),
                now_ns=self._clock.now_ns,
                stamp_ns=self._neighbours.sent_ns,
                wall_ns=self._clock.wall_ns,
                depth=depth,
                max_bytes=max_bytes,
                keep_oversize=keep_oversize,
                gather_s=gather_s,
            )
        )

    def alarm(
        self,
        key: str,
        raised: Callable[[int, int], None],
        ignored: Callable[[int], None],
        *,
        harmless: Harmless,
        idle: Callable[[int], None],
        asks_nothing: Harmless,
    ) -> AlarmSubscriber:
        """Raise an alarm for every sample on ``key``, unless it is recognised as harmless.

        Args:
            key: The key, without wildcards.
            raised: Called on the loop before everything else, with the number of alarms since its
                last call, and how many of them went unread because they were too long.
            ignored: Called on the loop with the number of harmless samples.
            harmless: Recognises their payloads; called in Zenoh's threads.
            idle: Called on the loop with the number of samples that ask for nothing.
            asks_nothing: Recognises their payloads; called in Zenoh's threads.
        """
        return self.declare(
            AlarmSubscriber(
                self.key(key),
                raised,
                ignored,
                harmless=harmless,
                idle=idle,
                asks_nothing=asks_nothing,
                inbox=self.inbox(),
            )
        )

    def serve(
        self,
        key: str,
        handler: Handler,
        *,
        fallback: Fallback,
        pending: int = 16,
        max_bytes: int = MAX_BYTES,
        wildcards: bool = False,
        harmless: Harmless | None = None,
        complete: bool = True,
    ) -> Service:
        """Answer queries on ``key``; every query gets an answer, unless it carries too much.

        Args:
            key: The key, without wildcards.
            handler: Answers on the loop, at once or as a coroutine.
            fallback: Makes the answer if the handler does not: it failed, too much is pending,
                the request is too large or was not meant for this key alone.
            pending: Queries that wait for the loop; more are answered by the fallback.
            max_bytes: The most that payload and attachment may have together. Few larger queries
                are kept at once; the others end without an answer.
            wildcards: Whether a query on ``**`` and the like may reach the handler.
            harmless: Makes it the service of an alarm. Every query whose payload this does not
                recognise raises it, and is delivered before everything else, without its payload
                if that is too large.
            complete: Declared as complete: a query that does not ask for all reaches it alone.
                Otherwise, such a query reaches all services of that key.
        """
        return self.declare(
            Service(
                key,
                self.key(key),
                handler,
                fallback,
                wildcards=wildcards,
                harmless=harmless,
                answering=self._answering,
                inbox=self.inbox(),
                now_ns=self._clock.now_ns,
                pending=pending,
                max_bytes=max_bytes,
                complete=complete,
            )
        )

    def token(self, key: str) -> Token:
        """Declare a liveliness token, alive as long as the bus.

        For several holders of one key see :func:`yahboomd.core.bus.keys.holder_key`.
        """
        self.inbox()
        return self.declare(Token(self.key(key)))

    def watch_tokens(
        self, pattern: str, handler: Callable[[list[TokenChange]], None]
    ) -> TokenWatch:
        """Report tokens that match ``pattern``, existing ones first.

        The session's own tokens are among them.
        """
        return self.declare(TokenWatch(self.key(pattern), handler, self.inbox()))

    def watch_neighbours(self, handler: Callable[[list[NeighbourChange]], None]) -> None:
        self._neighbours.watch(handler)

    @property
    def session(self) -> zenoh.Session:
        """The first session, for clients that make blocking queries.

        Raises:
            BusError: It is not open.
        """
        self.inbox()
        return self._sessions[0]

    def inbox(self) -> Inbox:
        """The way from Zenoh's threads to the loop.

        Raises:
            BusError: It is not open.
        """
        if self._inbox is None:
            raise BusError("The bus is not open.")
        return self._inbox


def _summed_counters(declared: Iterable[object]) -> dict[str, int]:
    """Sum their counters up.

    Consumers count the delivered samples. The losses of a ring of Zenoh's in a flood are unknown;
    ``samples_dropped`` counts at least one for each full ring.
    """
    found: Counter[str] = Counter()
    for each in declared:
        if isinstance(each, BusPublisher):
            found["puts"] += each.counters.puts
            found["put_errors"] += each.counters.errors
        elif isinstance(each, Subscription):
            found["samples_dropped"] += each.counters.dropped
            found["samples_oversize"] += each.counters.oversize
            found["floods"] += each.counters.floods
        elif isinstance(each, Service):
            found["requests"] += each.counters.requests
            found["requests_refused"] += each.counters.refused
            found["requests_failed"] += each.counters.failed
            found["answers_unsent"] += each.counters.unsent
        elif isinstance(each, TokenWatch):
            found["tokens_ignored"] += each.ignored
    return dict(found)
