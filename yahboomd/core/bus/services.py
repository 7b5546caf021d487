"""Answers queries: each gets an answer, even if its handler fails.

Handlers run on the loop. Answers are sent by a thread: an answer takes over the query's congestion
control, which blocks if the asker's connection is full, and a frozen asker must not hold
the loop.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Awaitable, Callable, Coroutine
from typing import TypeAlias

import msgspec
import zenoh
from zenoh.handlers import Callback

from yahboomd.core.bus.alarms import Harmless, is_named, raises_alarm
from yahboomd.core.bus.blocking import Sender
from yahboomd.core.bus.inbox import Inbox, SampleLane, carried_bytes

log = logging.getLogger(__name__)

HEAD_BYTES = 16
"""The bytes of a request that show its encoding."""

_HEAD_OF_BYTES = 65_536
"""A larger payload is refused unread: it can only be copied whole."""

TOO_MANY = "Too many requests at once."
"""The reason of a refusal whose query did not reach the loop."""

LATER = 64
"""Requests of one service whose answers are still awaited; each keeps its query."""


class BusQuery(msgspec.Struct, frozen=True, kw_only=True):
    """A query as it arrived.

    Attributes:
        key: The service's key, as it was declared.
        selector: The key that was asked for; differs from the service's if it has wildcards.
        payload: Its bytes; empty for none.
        encoding: The encoding that the asker named; empty for none.
        arrived_ns: When it arrived here; monotonic nanoseconds.
        oversize: Payload and attachment exceed the limit of the service: both are empty. Only an
            alarm's service sees such a request.
        harmless: It raises no alarm. Decided when it arrived; only an alarm's service asks.
        head: The first bytes, even if it is oversize: its answer must have its encoding.
    """

    key: str
    selector: str
    payload: bytes
    encoding: str
    attachment: bytes | None
    arrived_ns: int
    oversize: bool = False
    harmless: bool = False
    head: bytes = b""


class Response(msgspec.Struct, frozen=True, kw_only=True):
    """An answer: its bytes, their encoding, and an attachment if the protocol has one."""

    payload: bytes
    encoding: str = ""
    attachment: bytes | None = None


Handler: TypeAlias = Callable[[BusQuery], Response | Awaitable[Response]]
"""Answers on the loop, at once or later."""

Fallback: TypeAlias = Callable[[str, BusQuery], Response]
"""Makes the answer for a request that got none, from the reason, a sentence; from any thread."""


class ServiceCounters(msgspec.Struct, kw_only=True):
    """The counters of a service.

    Attributes:
        requests: Queries handed to the handler.
        answered: Answers sent, the fallback's included.
        refused: Queries answered by the fallback: too many, too large, a key with wildcards.
        failed: Queries whose handler raised or was cancelled.
        unsent: Answers that could not be sent, or had no query left to go to.
    """

    requests: int = 0
    answered: int = 0
    refused: int = 0
    failed: int = 0
    unsent: int = 0


class Pending(msgspec.Struct, frozen=True, kw_only=True):
    """A query on its way to the loop.

    Attributes:
        query: The query; None if it was too large to be kept.
        large: It holds one of the places of large queries, until it is answered.
    """

    query: zenoh.Query | None
    arrived_ns: int
    oversize: bool = False
    harmless: bool = False
    large: bool = False


class Answering(msgspec.Struct, frozen=True, kw_only=True):
    """State that the services of a bus share.

    Attributes:
        answers: Sends answers.
        acknowledgements: Sends those to queries that raise an alarm: they wait for no other answer.
        large: Places for queries of an oversize or unknown amount of data. A query can only be
            answered while all its data is kept.
    """

    answers: Sender
    acknowledgements: Sender
    large: threading.Semaphore


class Service:
    """One key that answers. Made by ``Bus.serve``.

    Args:
        name: The key as declared, below the namespace.
        key: The key in full.
        wildcards: Whether queries such as ``**`` reach it. Listing the network must not reset the
            odometry.
        harmless: Makes it the service of an alarm: every query that names its key (``is_named``)
            raises it, unless this recognises its payload. Decided as a query arrives, in
            Zenoh's thread.
    """

    def __init__(
        self,
        name: str,
        key: str,
        handler: Handler,
        fallback: Fallback,
        *,
        wildcards: bool,
        harmless: Harmless | None,
        answering: Answering,
        inbox: Inbox,
        now_ns: Callable[[], int],
        pending: int,
        max_bytes: int,
        complete: bool,
    ) -> None:
        self.name = name
        self.key = key
        self.counters = ServiceCounters()
        self._handler = handler
        self._fallback = fallback
        self._wildcards = wildcards
        self._harmless = harmless
        self._answering = answering
        self._tasks = set[asyncio.Task[None]]()
        self._now_ns = now_ns
        self._max_bytes = max_bytes
        self._complete = complete
        self._lane: SampleLane[Pending] = inbox.lane(self.handle, depth=pending, refuse=self.refuse)
        # A query that finds this lane full is refused. The queries in it still raise the alarm
        # when they are delivered.
        self._alarms: SampleLane[Pending] = inbox.lane(
            self.handle, depth=pending, urgent=True, refuse=self.refuse
        )

    def attach(self, session: zenoh.Session) -> None:

        def arrived(query: zenoh.Query) -> None:
            pending = self._admit(query)
            lane = self._lane if pending.harmless else self._alarms
            lane.offer(pending)

        session.declare_queryable(
            self.key, Callback(arrived, indirect=False), complete=self._complete
        )

    def handle(self, batch: list[Pending], _lost: int) -> None:
        for pending in batch:
            self._handle(pending)

    def refuse(self, pending: Pending, reason: str = TOO_MANY) -> None:
        """Answer by the fallback; from any thread."""
        self.counters.refused += 1
        self._answer(pending, self._instead(pending, reason))

    def close(self) -> tuple[asyncio.Task[None], ...]:
        """Cancel running requests; each is answered. Return their tasks, to be awaited."""
        for task in self._tasks:
            task.cancel()
        return tuple(self._tasks)

    def _admit(self, query: zenoh.Query) -> Pending:
        oversize = carried_bytes(query) > self._max_bytes
        raised = (
            self._harmless is not None
            and self._reached_by(str(query.key_expr))
            and raises_alarm(query, self._harmless)
        )
        # Parameters may be as long as a message, and only a copy would show their length.
        large = oversize or not query.parameters.is_empty()
        kept = not large or self._answering.large.acquire(blocking=False)
        return Pending(
            query=query if kept else None,
            arrived_ns=self._now_ns(),
            oversize=oversize,
            harmless=not raised,
            large=large and kept,
        )

    def _reached_by(self, selector: str) -> bool:
        if selector == self.key:
            return True
        return self._wildcards if self._harmless is None else is_named(self.name, selector)

    def _handle(self, pending: Pending) -> None:
        if pending.harmless and (pending.oversize or pending.query is None):
            self.refuse(pending, "The request has more bytes than this service takes.")
            return
        request = _request(self.name, self.key, pending)
        if not self._reached_by(request.selector):
            how = "without wildcards."
            if self._harmless is not None and is_named(self.name, self.key):
                last = self.key.rpartition("/")[2]
                how = (
                    f"or with wildcards before its last part, such as **/{last}. Nothing was done."
                )
            self.refuse(pending, f"Ask for {self.key} by its full name, {how}")
            return
        self.counters.requests += 1
        try:
            answer = self._handler(request)
        except Exception:
            self._fail(pending)
            log.exception("The service %s failed", self.key)
            return
        if isinstance(answer, Response):
            self._answer(pending, answer)
            return
        if len(self._tasks) >= LATER and isinstance(answer, Coroutine):
            answer.close()
            self.refuse(pending)
            return
        task = asyncio.ensure_future(self._later(pending, answer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _later(self, pending: Pending, answer: Awaitable[Response]) -> None:
        try:
            response = await answer
        except asyncio.CancelledError:
            self._fail(pending, "The service is being shut down.")
            raise
        except Exception:
            self._fail(pending)
            log.exception("The service %s failed", self.key)
            return
        self._answer(pending, response)

    def _fail(self, pending: Pending, reason: str = "The service failed; see its log.") -> None:
        self.counters.failed += 1
        self._answer(pending, self._instead(pending, reason))

    def _instead(self, pending: Pending, reason: str) -> Response:
        # The reason has the encoding of the request: a ROS 2 client that gets any other waits for
        # ever.
        return self._fallback(reason, _request(self.name, self.key, pending))

    def _answer(self, pending: Pending, response: Response) -> None:
        answering = self._answering
        sender = answering.answers if pending.harmless else answering.acknowledgements
        if not sender.send(lambda: self._send(pending, response)):
            self.counters.unsent += 1
            self._let_go(pending)

    def _send(self, pending: Pending, response: Response) -> None:
        if pending.query is None:
            self.counters.unsent += 1
            return
        try:
            pending.query.reply(
                self.key,
                response.payload,
                encoding=response.encoding or None,
                attachment=response.attachment,
            )
            self.counters.answered += 1
        except zenoh.ZError as error:  # the asker is gone, or the session
            self.counters.unsent += 1
            log.debug("No answer on %s: %s", self.key, error)
        finally:
            self._let_go(pending)

    def _let_go(self, pending: Pending) -> None:
        # The asker waits until the query ends here, not until the answer comes.
        if pending.query is not None:
            pending.query.drop()
        if pending.large:
            self._answering.large.release()


def _request(name: str, key: str, pending: Pending) -> BusQuery:
    query = pending.query
    if query is None:
        return BusQuery(
            key=name,
            selector=key,
            payload=b"",
            encoding="",
            attachment=None,
            arrived_ns=pending.arrived_ns,
            oversize=pending.oversize,
            harmless=pending.harmless,
        )
    payload, attachment = query.payload, query.attachment
    data = b""
    if payload is not None and (not pending.oversize or len(payload) <= _HEAD_OF_BYTES):
        data = payload.to_bytes()
    return BusQuery(
        key=name,
        selector=str(query.key_expr),
        payload=b"" if pending.oversize else data,
        encoding="" if query.encoding is None else str(query.encoding),
        attachment=None if attachment is None or pending.oversize else attachment.to_bytes(),
        arrived_ns=pending.arrived_ns,
        oversize=pending.oversize,
        harmless=pending.harmless,
        head=data[:HEAD_BYTES],
    )
