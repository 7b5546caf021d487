"""When a board that is asked sampled its counters.

Law: stamps increase, and none is later than the moment at which its line left the board. If a burst
of late lines leaves no room between the two, a reading is skipped: the next one contains its
counts. Steps are measured in the board's own time.

A board that is asked answers at once: its stamp is the request's time plus the shortest turn-round.
"""

from __future__ import annotations

import math
from collections import deque

import msgspec

from yahboomd.core.model import EncoderReading

TURN_ROUNDS = 64

PROMPT_NS = 20_000_000
"""An answer at most this much slower than the shortest is prompt: the worst USB latency."""

PROMPT_ANSWERS = 3
"""The prompt answers in a row, each to its own request, that pair answers and requests again."""

PAIRED_NS = 2_000_000
"""An answer slower than the shortest by more than this may answer an earlier request: such a board
works on a backlog, and sampled at any time since the newest request."""


class Instant(msgspec.Struct, frozen=True):
    """The time of one reading.

    Attributes:
        stamp_ns: When the board sampled; monotonic nanoseconds of the host.
        step_ns: Time since the last accepted reading, on the board's clock; 0 for a reading that
            shows nothing new.
        unsure_ns: The longest time from the sampling until the line left, if it exceeds an
            ordinary delay; of a stream, how much shorter the step may have been.
    """

    stamp_ns: int
    step_ns: int
    unsure_ns: int = 0


class PolledClock:
    """Stamps of a board that answers requests.

    Without the time of the request, a stamp is the moment the answer left the board, with the
    receiving side's jitter in it. With it, the stamp is the request's time plus the shortest of
    the last 64 turn-rounds, which is the board's own.

    Args:
        after_ns: The last stamp of another clock; 0 for none.
    """

    __slots__ = "_turn_rounds _stamp_ns _requested_ns _sole _prompt".split()

    rough_ns = 0

    def __init__(self, after_ns: int = 0) -> None:
        self._turn_rounds: deque[int] = deque(maxlen=TURN_ROUNDS)
        self._stamp_ns = after_ns
        self._requested_ns: int | None = None
        self._sole = True
        self._prompt = 0

    def fresh(self, reading: EncoderReading) -> bool:  # noqa: ARG002
        """Always: an old answer is recognised because the next one disagrees."""
        return True

    def pass_over(self, reading: EncoderReading) -> None:
        """Note a line whose counts are not used."""

    def restart(self, reading: EncoderReading) -> Instant:
        """Continue after a break: the step is the time since the last stamp.

        The board needs as long for an answer as before: the first one after the break may have
        waited for a process that did not run.
        """
        self._prompt = 0
        return self.observe(reading)

    def resume(self, reading: EncoderReading, *, ticks: int) -> Instant:  # noqa: ARG002
        """Continue after a gap in which the board kept counting."""
        return self.restart(reading)

    def elapsed_at_most_ns(self, reading: EncoderReading) -> int:
        """The longest time that can have passed since the last accepted reading.

        The board sampled before it sent, but it may have received the request late.
        """
        return reading.sent_ns - self._stamp_ns

    def observe(
        self,
        reading: EncoderReading,
        *,
        ticks: int = 0,  # noqa: ARG002 - what the other clock needs
        least_ns: float = 0.0,
    ) -> Instant:
        """Stamp a reading.

        Args:
            ticks: Not used.
            least_ns: The least time that its travel takes: it shows a request that was received
                late.
        """
        unsure_ns, sent_ns = 0, reading.sent_ns
        if reading.requested_ns is not None:
            unsure_ns = self._unsure(sent_ns, reading.requested_ns, reading.earliest_ns)
        last_ns = self._stamp_ns
        stamp_ns = sent_ns if unsure_ns else self.guess_ns(reading)
        if last_ns and stamp_ns < last_ns + least_ns:
            stamp_ns = min(sent_ns, last_ns + math.ceil(least_ns))
        if stamp_ns < last_ns + max(1.0, least_ns):
            return Instant(last_ns, 0)
        self._stamp_ns = stamp_ns
        return Instant(stamp_ns, stamp_ns - last_ns if last_ns else 0, unsure_ns)

    def _unsure(self, sent_ns: int, requested_ns: int, earliest_ns: int | None) -> int:
        turn_rounds, took_ns = self._turn_rounds, sent_ns - requested_ns
        own = requested_ns != self._requested_ns
        self._requested_ns = requested_ns
        sole = own and earliest_ns in (None, requested_ns)
        if self._sole and not sole:
            # A request was not answered in time: the next answer may be to any of them.
            self._prompt = 0
        self._sole = sole
        shortest_ns = min(turn_rounds, default=took_ns if sole else 0)
        # An answer that left before the newest request answers an earlier one.
        prompt = own and took_ns > 0 and -1_000_000 <= took_ns - shortest_ns <= PROMPT_NS
        self._prompt = self._prompt + 1 if prompt else 0
        paired = self._prompt >= PROMPT_ANSWERS
        if sole or (paired and took_ns - shortest_ns <= PAIRED_NS):
            # The turn-round of an answer to another request would be too short.
            turn_rounds.append(took_ns)
        elif paired:
            return took_ns - shortest_ns
        if sole or paired or earliest_ns is None:
            earliest_ns = requested_ns
        unsure_ns = sent_ns - earliest_ns - shortest_ns
        return unsure_ns if unsure_ns > PROMPT_NS else 0

    def guess_ns(self, reading: EncoderReading) -> int:
        if reading.requested_ns is None or not self._turn_rounds:
            return reading.sent_ns
        return min(reading.sent_ns, reading.requested_ns + min(self._turn_rounds))
