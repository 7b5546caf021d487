"""The first of the two coroutines that share the stream: it drains the outbox.

One command is in flight at a time (the board's mailbox holds one and is wiped after each): after a
frame the line is closed until its bytes are out and the dialect's spacing is over, and, where it
has an answer, until that came or is overdue. A frame that finds the line free is written at once,
from whoever brings it; the coroutine sees to those that had to wait and to what is said again.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque

from yahboomd.clock import Clock, nanoseconds
from yahboomd.errors import PortLost
from yahboomd.link.outbox import Answers, Lane, Outbox, Request
from yahboomd.link.port import Port
from yahboomd.protocol.dialect import CommandLost, Decoded, Deltas, Speeds, Totals

AFTER_ANSWER_NS = 2_000_000
"""The board wipes its mailbox when it is through with answering, a moment after the last byte."""

UNANSWERED = 16
LATEST_ANSWER_NS = 300_000_000
"""No answer is later than that, however busy this machine is; those questions are forgotten."""

STUCK_NS = 300_000_000
"""A port that took nothing for so long takes nothing any more: only opening it anew helps."""


class Writer:
    """Owns the outgoing half of a port.

    Args:
        port: The open port.
        clock: What tells the time.
        resend_ns: How often the current velocity is said again.
        spacing_ns: From the last byte of a frame to the first of the next.
    """

    def __init__(self, port: Port, clock: Clock, *, resend_ns: int, spacing_ns: int) -> None:
        self._port = port
        self._clock = clock
        self._outbox = Outbox(resend_ns=resend_ns)
        self._spacing_ns = spacing_ns
        self._free_ns = 0
        self._flight: Request | None = None
        self._flight_until_ns: int | None = None
        self._polled_until_ns: int | None = None
        self._wake = asyncio.Event()
        self._alarm = clock.alarm(self._wake.set)
        self._poll_timeout_ns = 0
        self._full_since_ns: int | None = None
        self._closed = False
        self.poll_heard_ns = 0
        self._unanswered: deque[int] = deque(maxlen=UNANSWERED)
        self._surplus_since_ns: int | None = None
        self.counters: Counter[str] = Counter()

    def facts(self) -> dict[str, int]:
        """Its counters, and how many velocities another one replaced before they went out."""
        return {**self.counters, "velocities_replaced": self._outbox.replaced}

    def set_spacing(self, spacing_ns: int) -> None:
        """Keep another distance between frames, now that the dialect is known."""
        self._spacing_ns = spacing_ns

    # What others ask for; each is written at once where the line is free.

    def velocity(self, frame: bytes) -> None:
        """Say this velocity, and say it again until another replaces it."""
        self._outbox.velocity(frame)
        self._pump()

    def stop(self, frames: tuple[bytes, ...]) -> None:
        """Stop: before everything else, forgetting the velocity that was said."""
        self._outbox.stop(frames)
        self._pump()

    def quiet(self) -> None:
        """Say no velocity any more."""
        self._outbox.quiet()

    def poll(self, frame: bytes, timeout_ns: int) -> bool:
        """Ask for the counters, as soon as the previous question is answered or overdue.

        Returns:
            ``False`` where a question waits already: a line that is slower than the schedule is
            kept busy by one that waits, and more would be stale when they go.
        """
        if not self._outbox.poll(frame):
            return False
        self._poll_timeout_ns = timeout_ns
        self._pump()
        return True

    def tell(self, frame: bytes) -> None:
        """Queue a frame of the configuration lane that has no answer."""
        self._outbox.request(
            Request(frame=frame, answered=_never, timeout_ns=0, done=_nobody_waits)
        )
        self._pump()

    async def request(self, frame: bytes, answered: Answers, timeout_s: float) -> bool:
        """Send a frame and wait until ``answered`` says that its answer is complete.

        Returns:
            Whether the answer came in time, counted from the frame's last byte.
        """
        future: asyncio.Future[bool] = asyncio.get_running_loop().create_future()

        def done(result: bool) -> None:
            if not future.done():
                future.set_result(result)

        request = Request(
            frame=frame, answered=answered, timeout_ns=nanoseconds(timeout_s), done=done
        )
        self._outbox.request(request)
        self._pump()
        try:
            return await future
        finally:
            self._outbox.withdraw(request)
            if self._flight is request:
                self._flight = None
                self._flight_until_ns = None

    def heard(self, decoded: Decoded) -> None:
        """Something came from the board: it may be what a frame waits for."""
        if isinstance(decoded, Totals):
            if self._polled_until_ns is not None:
                self._polled_until_ns = None
                self._pump()
            if self._flight is None:
                return
        elif isinstance(decoded, Deltas | Speeds):
            return
        elif isinstance(decoded, CommandLost):
            self.counters["commands_lost"] += 1
            if self._flight is None:
                self._outbox.velocity_lost()
        flight = self._flight
        if flight is not None and flight.answered(decoded):
            self._land(answered=True)
            self._free_ns = self._clock.now_ns() + AFTER_ANSWER_NS
        self._wake.set()

    def close(self) -> None:
        """Write nothing any more: whatever waits, the last words are somebody else's."""
        self._closed = True

    def answered_poll_ns(self) -> int | None:
        """Counts came: when was the board asked for them, at the earliest? Called once for each.

        Answers come in the order of the questions. One that was lost makes the moment too early for
        a while, which errs on the safe side; one that came late does not make it too late.
        """
        asked = self._unanswered
        if not asked:
            return None
        first_ns = asked.popleft()
        now_ns = self._clock.now_ns()
        if not asked:
            self._surplus_since_ns = None
        elif self._surplus_since_ns is None:
            self._surplus_since_ns = now_ns
        elif now_ns - self._surplus_since_ns >= LATEST_ANSWER_NS:
            asked.clear()
            self._surplus_since_ns = None
        return first_ns

    # The coroutine.

    async def run(self) -> None:
        """Send what waits, when the line allows it. Ends by being cancelled.

        Raises:
            PortLost: The port takes no output any more.
        """
        try:
            while True:
                self._wake.clear()
                self._pump()
                if self._stuck:
                    raise PortLost(
                        f"{self._port.name}: the port takes no output.",
                        remedy="It is opened anew, which forgets what it holds back.",
                    )
                await self._wake.wait()
        finally:
            self._alarm.close()
            if self._flight is not None:
                self._land(answered=False)

    def _land(self, *, answered: bool) -> None:
        flight, self._flight, self._flight_until_ns = self._flight, None, None
        if flight is not None:
            if not answered:
                self.counters["answers_missed"] += 1
            flight.done(answered)

    @property
    def _stuck(self) -> bool:
        full_ns = self._full_since_ns
        return full_ns is not None and self._clock.now_ns() - full_ns >= STUCK_NS

    def _pump(self) -> None:
        if self._closed:
            return
        now_ns = self._clock.now_ns()
        self._expire(now_ns)
        while now_ns >= self._free_ns:
            if self._port.pending:
                # The kernel is full: nothing more until it took what it has; a stop, too, could
                # only queue behind it.
                self.counters["port_full"] += 1
                self._full_since_ns = self._full_since_ns or now_ns
                self._free_ns = now_ns + 16 * self._port.byte_ns
                break
            self._full_since_ns = None
            busy = self._flight is not None or self._polled_until_ns is not None
            outgoing = self._outbox.take(now_ns, busy=busy)
            if outgoing is None:
                break
            end_ns = now_ns + len(outgoing.frame) * self._port.byte_ns
            self._port.write(outgoing.frame)
            self.counters[_SENT[outgoing.lane]] += 1
            self._free_ns = end_ns + self._spacing_ns
            if outgoing.request is not None and outgoing.request.timeout_ns > 0:
                self._flight = outgoing.request
                self._flight_until_ns = end_ns + outgoing.request.timeout_ns
            elif outgoing.lane is Lane.POLL:
                # The board cannot answer before the question is all there.
                self.poll_heard_ns = end_ns
                self._unanswered.append(end_ns)
                self._polled_until_ns = end_ns + self._poll_timeout_ns
            if now_ns < self._free_ns:
                break
        self._alarm.set(self._next_ns())

    def _expire(self, now_ns: int) -> None:
        if self._flight_until_ns is not None and now_ns >= self._flight_until_ns:
            self._land(answered=False)
        if self._polled_until_ns is not None and now_ns >= self._polled_until_ns:
            self._polled_until_ns = None
            self.counters["polls_unanswered"] += 1

    def _next_ns(self) -> int | None:
        """When there may be something to do again."""
        moments = [each for each in (self._flight_until_ns, self._polled_until_ns) if each]
        if self._outbox.stopping:
            moments.append(self._free_ns)
        elif not moments:
            if self._outbox.waiting:
                moments.append(self._free_ns)
            elif (resend_ns := self._outbox.resend_at_ns) is not None:
                moments.append(max(resend_ns, self._free_ns))
        return min(moments) if moments else None


def _never(_decoded: Decoded) -> bool:
    return False


def _nobody_waits(_answered: bool) -> None:
    pass


_SENT = {
    Lane.STOP: "stops_sent",
    Lane.VELOCITY: "velocities_sent",
    Lane.POLL: "polls_sent",
    Lane.CONFIGURATION: "requests_sent",
}
