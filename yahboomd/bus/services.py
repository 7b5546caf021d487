"""Queries in, answers out: a query always gets an answer, whatever becomes of its handler.

Handlers run on the loop. Answers are sent by a thread: an answer takes over the query's congestion
control, which blocks where the asker's connection is full, and an asker that froze must not hold
the loop.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import TypeAlias

import msgspec
import zenoh
from zenoh.handlers import Callback

from yahboomd.bus.inbox import Inbox, Lane
from yahboomd.bus.sender import Sender

log = logging.getLogger(__name__)

HEAD_BYTES = 16
"""Enough of a request to see how it is encoded."""

_HEAD_OF_BYTES = 65_536
"""Of a larger payload not even the beginning is looked at: it can only be copied whole."""


class Request(msgspec.Struct, frozen=True, kw_only=True):
    """A query as it arrived.

    Attributes:
        key: The service's key, as it was declared.
        selector: The key that was asked for; differs from the service's where it has wildcards.
        parameters: What stood behind the ``?``.
        payload: Its bytes; empty for none.
        encoding: What the asker says that they are; empty for none.
        attachment: The asker's attachment.
        arrived_ns: When it arrived here; monotonic nanoseconds.
        oversize: More bytes than the service takes: ``payload`` is empty. Only a service with
            ``keep_oversize`` sees such a request.
        head: The first bytes, of one that is oversize too: its answer is to be in its encoding.
    """

    key: str
    selector: str
    parameters: str
    payload: bytes
    encoding: str
    attachment: bytes | None
    arrived_ns: int
    oversize: bool = False
    head: bytes = b""


class Response(msgspec.Struct, frozen=True, kw_only=True):
    """An answer: its bytes, what they are, and an attachment where the protocol has one."""

    payload: bytes
    encoding: str = ""
    attachment: bytes | None = None


Handler: TypeAlias = Callable[[Request], Response | Awaitable[Response]]
"""Answers on the loop, at once or later."""

Fallback: TypeAlias = Callable[[str, Request], Response]
"""Makes the answer for a request that got none, from the reason, a sentence; from any thread."""


class ServiceCounters(msgspec.Struct, kw_only=True):
    """What a service has seen.

    Attributes:
        requests: Queries handed to the handler.
        answered: Answers sent, the fallback's included.
        refused: Queries answered by the fallback: too many, too large, a key with wildcards.
        failed: Queries whose handler raised or was cancelled.
        unsent: Answers that could not be sent.
    """

    requests: int = 0
    answered: int = 0
    refused: int = 0
    failed: int = 0
    unsent: int = 0


class Pending(msgspec.Struct, frozen=True, kw_only=True):
    """A query on its way to the loop."""

    query: zenoh.Query
    arrived_ns: int
    oversize: bool


class Service:
    """One key that answers. Made by ``Bus.serve``.

    Args:
        name: The key as declared, below the namespace.
        key: The key in full.
        handler: Answers a request.
        fallback: Answers for it when it does not.
        wildcards: Whether ``**`` may ask: else somebody who lists the network would reset the
            odometry by it.
        keep_oversize: Hand over requests that are too large, without their payload.
        answers: Sends them.
        inbox: Brings the queries to the loop.
        now_ns: Stamps what arrives.
        pending: Queries that wait for the loop.
        max_bytes: The largest payload taken.
        urgent: Before all that is not.
        complete: Declared as complete.
    """

    def __init__(
        self,
        name: str,
        key: str,
        handler: Handler,
        fallback: Fallback,
        *,
        wildcards: bool,
        keep_oversize: bool,
        answers: Sender,
        inbox: Inbox,
        now_ns: Callable[[], int],
        pending: int,
        max_bytes: int,
        urgent: bool,
        complete: bool,
    ) -> None:
        self.name = name
        self.key = key
        self.counters = ServiceCounters()
        self._handler = handler
        self._fallback = fallback
        self._wildcards = wildcards
        self._keep_oversize = keep_oversize
        self._answers = answers
        self._tasks = set[asyncio.Task[None]]()
        self._now_ns = now_ns
        self._max_bytes = max_bytes
        self._complete = complete
        self._lane: Lane[Pending] = inbox.lane(
            self.handle, depth=pending, urgent=urgent, refuse=self.refuse
        )

    def attach(self, session: zenoh.Session) -> None:
        """Answer in this session too."""
        lane, now_ns, max_bytes = self._lane, self._now_ns, self._max_bytes

        def arrived(query: zenoh.Query) -> None:
            payload, attachment = query.payload, query.attachment
            size = 0 if payload is None else len(payload)
            if attachment is not None:
                size = max(size, len(attachment))
            lane.offer(Pending(query=query, arrived_ns=now_ns(), oversize=size > max_bytes))

        session.declare_queryable(
            self.key, Callback(arrived, indirect=False), complete=self._complete
        )

    def handle(self, batch: list[Pending], _lost: int) -> None:
        """Answer a batch; on the loop."""
        for pending in batch:
            self._handle(pending)

    def refuse(self, pending: Pending, reason: str = "Too many requests at once.") -> None:
        """Answer by the fallback; from any thread."""
        self.counters.refused += 1
        self._answer(pending.query, self._instead(pending, reason))

    def close(self) -> tuple[asyncio.Task[None], ...]:
        """Cancel what is under way; each is answered. Returns the tasks, to be waited for."""
        for task in self._tasks:
            task.cancel()
        return tuple(self._tasks)

    def _handle(self, pending: Pending) -> None:
        query = pending.query
        selector = str(query.key_expr)
        if pending.oversize and not self._keep_oversize:
            self.refuse(pending, "The request has more bytes than this service takes.")
            return
        if selector != self.key and not self._wildcards:
            self.refuse(pending, f"Ask for {self.key} by its full name, without wildcards.")
            return
        self.counters.requests += 1
        try:
            answer = self._handler(_request(self.name, selector, pending))
        except Exception:
            self._fail(pending)
            log.exception("The service %s failed", self.key)
            return
        if isinstance(answer, Response):
            self._answer(query, answer)
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
        self._answer(pending.query, response)

    def _fail(self, pending: Pending, reason: str = "The service failed; see its log.") -> None:
        self.counters.failed += 1
        self._answer(pending.query, self._instead(pending, reason))

    def _instead(self, pending: Pending, reason: str) -> Response:
        # What asked is told the reason in its own encoding: a ROS 2 client that is sent anything
        # else waits for ever.
        selector = str(pending.query.key_expr)
        return self._fallback(reason, _request(self.name, selector, pending))

    def _answer(self, query: zenoh.Query, response: Response) -> None:
        if not self._answers.send(lambda: self._send(query, response)):
            self.counters.unsent += 1
            query.drop()

    def _send(self, query: zenoh.Query, response: Response) -> None:
        try:
            query.reply(
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
            # The asker waits until the query ends here, not until the answer comes.
            query.drop()


def _request(name: str, selector: str, pending: Pending) -> Request:
    query = pending.query
    payload, attachment = query.payload, query.attachment
    data = b""
    if payload is not None and (not pending.oversize or len(payload) <= _HEAD_OF_BYTES):
        data = payload.to_bytes()
    return Request(
        key=name,
        selector=selector,
        parameters=str(query.parameters),
        payload=b"" if pending.oversize else data,
        encoding="" if query.encoding is None else str(query.encoding),
        attachment=None if attachment is None or pending.oversize else attachment.to_bytes(),
        arrived_ns=pending.arrived_ns,
        oversize=pending.oversize,
        head=data[:HEAD_BYTES],
    )
