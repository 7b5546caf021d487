"""Writes what the outbox holds to the port, as soon as the line allows it.

One command is in flight at a time, because a board may keep no more than one: after a frame the
line is closed until its bytes are out and the dialect's spacing is over. If the frame has an
answer, other questions wait until that came or is overdue, and velocities until the board can take
one: a missing answer must not delay a robot that is to brake. A frame that finds the
line free is written at once, by its caller; the coroutine handles those that had to wait
and the repeats.

Nothing is written while the system still holds bytes of an earlier frame: a queued frame
cannot be taken back, so that a stop would wait behind all of it. Velocities wait in their slot, the
newest wins, and a stop has one frame before it at most, even if the port sends slowly.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Callable

import msgspec

from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.link.draining import OutputWatch
from yahboomd.core.link.outbox import Answers, FrameLane, Outbox, Question
from yahboomd.core.link.port import Port
from yahboomd.core.link.port_errors import takes_no_output
from yahboomd.core.protocol.dialect import CommandLost, Decoded, Deltas, Speeds, Totals, Unused


class Spacing(msgspec.Struct, frozen=True, kw_only=True):
    """The distance between two frames, so that the board can take the second.

    Attributes:
        frame_ns: From the last byte of a frame to the first of the next.
        question_ns: From that of a question to a velocity, if no answer came before.
        answer_ns: From the end of an answer to the next frame.
    """

    frame_ns: int
    question_ns: int = 0
    answer_ns: int = 0


UNANSWERED = 256
"""The most unanswered questions that are remembered: more than are asked before a silent board is
given up. Late answers arrive together, in their order."""

HELD_BACK_NS = 100_000_000
LATEST_ANSWER_NS = 300_000_000
"""No answer is later than that, even on a busy machine; those questions are forgotten."""


class Writer:
    """Owns the outgoing half of a port.

    Args:
        resend_ns: The period at which the current velocity is repeated.

    Attributes:
        spacing: As given; the dialect's own, once it is known.
        resync: Sent before each speed and stop: half a frame left in the board swallows this.
        closed: Nothing is written: the last frames are the line's.
        stopped: Whether the guard stopped the wheels, so that no motion is written.
        on_sent: Called with its lane when a frame is written to the port.
        on_slow: Called once, with the bytes per second, if the port sends slower than its rate.
    """

    def __init__(self, port: Port, clock: Clock, *, resend_ns: int, spacing: Spacing) -> None:
        self._port = port
        self._clock = clock
        self._outbox = Outbox(resend_ns=resend_ns)
        self.spacing = spacing
        self._free_ns = 0
        self._flight: Question | None = None
        self._flight_until_ns: int | None = None
        self._flight_end_ns = 0
        self._flight_alone = False
        self._missed: Question | None = None
        self._hold_ns = 0
        self._polled_until_ns: int | None = None
        self._wake = asyncio.Event()
        self._alarm = clock.alarm(self._ring)
        self._poll_timeout_ns = 0
        self._output = OutputWatch(port.queued, port.byte_ns)
        self._slowness_reported = False
        self._held = False
        self.closed = False
        self.stopped: Callable[[], bool] = lambda: False
        self.resync = b""
        self.poll_heard_ns = 0
        self._unanswered: deque[int] = deque(maxlen=UNANSWERED)
        self._surplus_since_ns: int | None = None
        self._answered_ns = 0
        self.counters: Counter[str] = Counter()
        self.on_sent: Callable[[FrameLane], None] = lambda _lane: None
        self.on_slow: Callable[[float], None] = lambda _bytes_per_s: None

    def status_values(self) -> dict[str, int]:
        """Its counters, and the number of velocities that were replaced before they went out."""
        return {**self.counters, "velocities_replaced": self._outbox.replaced}

    def set_resend(self, resend_ns: int) -> None:
        self._outbox.resend_ns = resend_ns

    # Requests of others; each is written at once if the line is free.

    def velocity(self, frame: bytes) -> None:
        """Send this velocity, and repeat it until another replaces it."""
        if self._outbox.velocity(frame):
            self._pump()

    def stop(self, frames: tuple[bytes, ...]) -> None:
        """Stop: before everything else, discarding the velocity that was sent."""
        self._outbox.stop(frames)
        self._pump()

    @property
    def stopping(self) -> bool:
        return self._outbox.stopping

    def quiet(self) -> None:
        self._outbox.quiet()

    def poll(self, frame: bytes, timeout_ns: int) -> bool:
        """Ask for the counters, as soon as the previous question is answered or overdue.

        Returns:
            ``False`` if a question waits already: a line that is slower than the schedule is
            kept busy by one that waits, and more would be stale when they go.
        """
        if not self._outbox.poll(frame):
            return False
        self._poll_timeout_ns = timeout_ns
        self._pump()
        return True

    def queue(self, frame: bytes) -> None:
        """Queue a frame of the configuration lane that has no answer."""
        self._outbox.request(Question(frame=frame, answered=_never, timeout_ns=0, done=_unawaited))
        self._pump()

    async def request(self, frame: bytes, answered: Answers, timeout_s: float) -> bool:
        """Send a frame and wait until ``answered`` accepts its complete answer.

        Returns:
            Whether the answer came in time, counted from the frame's last byte.
        """
        future: asyncio.Future[bool] = asyncio.get_running_loop().create_future()

        def done(result: bool) -> None:
            if not future.done():
                future.set_result(result)

        request = Question(
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

    def receive(self, decoded: Decoded, received_ns: int | None = None) -> None:
        """Note a decoded item of the board: a frame may wait for it.

        Args:
            received_ns: When it came, if that is not now.
        """
        if isinstance(decoded, Totals):
            if self._polled_until_ns is not None:
                now_ns = self._clock.now_ns()
                overdue = (received_ns or now_ns) >= self._polled_until_ns
                self._polled_until_ns = None
                if overdue:
                    self.counters["polls_unanswered"] += 1
                    # This process may not have run: the consequences of the counts go first.
                    self._wake.set()
                elif self._outbox.waits(max(now_ns, self._hold_ns)):
                    self._pump()
            if self._flight is None:
                return
        elif isinstance(decoded, Deltas | Speeds | Unused):
            return
        elif isinstance(decoded, CommandLost):
            self.counters["commands_lost"] += 1
            self._outbox.velocity_lost()
        flight = self._flight
        if flight is not None and flight.answered(decoded):
            self._land(answered=True)
            if self._flight_alone:
                # It may be the answer to an earlier question: this one must be sent completely.
                self._free_ns = (
                    max(self._clock.now_ns(), self._flight_end_ns) + self.spacing.answer_ns
                )
        elif flight is None and self._missed is not None and self._missed.answered(decoded):
            self._missed = None
            self.counters["answers_late"] += 1
        self._wake.set()

    def answered_poll_ns(self) -> int | None:
        """The earliest moment at which the arrived counts were requested. Called once for each.

        Answers come in the order of the questions. A lost one makes the moment too early for
        a while, which errs on the safe side; a late one does not make it too late.
        """
        asked = self._unanswered
        if not asked:
            return None
        first_ns = asked.popleft()
        now_ns = self._clock.now_ns()
        answered_ns, self._answered_ns = self._answered_ns, now_ns
        if not asked:
            self._surplus_since_ns = None
        elif self._surplus_since_ns is None or now_ns - answered_ns >= HELD_BACK_NS:
            # After a time without answers the held ones come in one burst.
            self._surplus_since_ns = now_ns
        elif now_ns - self._surplus_since_ns >= LATEST_ANSWER_NS:
            asked.clear()
            self._surplus_since_ns = None
        return first_ns

    # The coroutine.

    async def run(self) -> None:
        """Send waiting frames when the line allows it. Ends by being cancelled.

        Raises:
            PortLost: The port takes no output any more.
        """
        try:
            while True:
                self._wake.clear()
                self._pump()
                if not self.closed and self._output.stuck(self._clock.now_ns()):
                    raise takes_no_output(self._port.name)
                await self._wake.wait()
        finally:
            self._alarm.close()
            if self._flight is not None:
                self._land(answered=False)

    def _land(self, *, answered: bool) -> None:
        flight, self._flight, self._flight_until_ns = self._flight, None, None
        if flight is not None:
            self._missed = None if answered else flight
            if not answered:
                self.counters["answers_missed"] += 1
            flight.done(answered)

    def _pump(self) -> None:
        if self.closed:
            return
        now_ns = self._clock.now_ns()
        if self._asking:
            self._expire(now_ns)
        while now_ns >= self._free_ns:
            asking = self._asking
            due_ns = self._outbox.due_ns(asking=asking)
            if due_ns is None or due_ns > now_ns:
                break
            if self._output.holds(now_ns):
                # Even a stop could only queue behind it.
                if not self._held:
                    self.counters["port_held"] += 1
                self._held = True
                self._free_ns = now_ns + 16 * self._port.byte_ns
                break
            if self._held:
                # The held bytes left just now.
                self._held = False
                self._notice_slowness()
                self._free_ns = now_ns + self.spacing.frame_ns
                continue
            busy = asking and now_ns < self._hold_ns
            outgoing = self._outbox.take(now_ns, busy=busy, asking=asking)
            if outgoing is None:
                break
            if outgoing.lane is FrameLane.VELOCITY and self.stopped():
                self.counters["velocities_withheld"] += 1
                continue
            commands = outgoing.lane in (FrameLane.STOP, FrameLane.VELOCITY)
            frame = self.resync + outgoing.frame if commands else outgoing.frame
            end_ns = now_ns + len(frame) * self._port.byte_ns
            self._port.write(frame)
            self._output.wrote(len(frame), now_ns)
            self.counters[_SENT[outgoing.lane]] += 1
            self.on_sent(outgoing.lane)
            self._free_ns = end_ns + self.spacing.frame_ns
            self._flight_alone = False
            if outgoing.request is not None and outgoing.request.timeout_ns > 0:
                self._flight = outgoing.request
                self._flight_until_ns = end_ns + outgoing.request.timeout_ns
                self._flight_end_ns = end_ns
                self._flight_alone = True
                self._hold_ns = end_ns + self.spacing.question_ns
            elif outgoing.lane is FrameLane.POLL:
                # The board cannot answer before the question has arrived completely.
                self.poll_heard_ns = end_ns
                self._unanswered.append(end_ns)
                self._hold_ns = end_ns + self.spacing.question_ns
                self._polled_until_ns = end_ns + self._poll_timeout_ns
            if now_ns < self._free_ns:
                break
        self._alarm.set(self._next_ns())

    def _ring(self) -> None:
        # Repeats go out in the loop's iteration that the timer woke.
        self._pump()
        if self._output.stuck(self._clock.now_ns()):
            self._wake.set()

    @property
    def _asking(self) -> bool:
        return self._flight is not None or self._polled_until_ns is not None

    def _notice_slowness(self) -> None:
        rate = self._output.slow_bytes_per_s
        if rate is not None:
            self.counters["port_slow"] += 1
            self._output.slow_bytes_per_s = None
            if not self._slowness_reported:
                self._slowness_reported = True
                self.on_slow(rate)

    def _expire(self, now_ns: int) -> None:
        if self._flight_until_ns is not None and now_ns >= self._flight_until_ns:
            self._land(answered=False)
        if self._polled_until_ns is not None and now_ns >= self._polled_until_ns:
            self._polled_until_ns = None
            self.counters["polls_unanswered"] += 1

    def _next_ns(self) -> int | None:
        asking = self._asking
        next_ns = self._outbox.due_ns(asking=asking)
        if next_ns is not None:
            held = asking and not self._outbox.stopping
            next_ns = max(next_ns, self._free_ns, self._hold_ns if held else 0)
        # Only another question waits for the answer to a poll; the next poll checks by itself.
        polled_ns = self._polled_until_ns if self._outbox.questions else None
        for until_ns in (self._flight_until_ns, polled_ns):
            if until_ns is not None and (next_ns is None or until_ns < next_ns):
                next_ns = until_ns
        return next_ns


def _never(_decoded: Decoded) -> bool:
    return False


def _unawaited(_answered: bool) -> None:
    pass


_SENT = {
    FrameLane.STOP: "stops_sent",
    FrameLane.VELOCITY: "velocities_sent",
    FrameLane.POLL: "polls_sent",
    FrameLane.CONFIGURATION: "requests_sent",
}
