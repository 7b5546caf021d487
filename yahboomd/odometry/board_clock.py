"""When the board sampled its counters.

Law: a stamp never runs backwards, and steps are counted in the board's own time.

A board that streams renews its totals on a tick of its own (10 ms) and sends lines at another rate;
between the two lies a USB bridge that may hold bytes back for up to 16 ms. What is certain: a line
with the totals of tick n cannot arrive before tick n. So arrival times, plotted over the number of
the tick, lie above a straight line, whose offset is the phase of the board's clock and whose slope
its true period; the line is found from below (:mod:`yahboomd.odometry.envelope`). Ticks are counted
while the wheels turn fast enough that every tick changes the totals; at rest and at a crawl time
counts them, and stamps are good to a tick.

A board that is asked answers at once: its stamp is the request's time plus the shortest turn-round.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from yahboomd.odometry.arrivals import Arrivals
from yahboomd.odometry.envelope import Envelope

FAST_TICKS = 3
"""From so many counts a tick on, a tick without any would be a miracle."""

EARLY_NS = 3_000_000
"""How early a line may come before its tick as it is known; earlier, it was numbered wrongly."""

STEADY_NS = 500_000_000
"""Lines that are late for so long, all of them, have been numbered too low."""

QUIET_TICKS = 1.5
"""Lines without a change are repeats, unless they go on for longer than this."""

STALL_NS = 500_000_000
"""So late is no backlog of the host: the lines of that time are lost."""

TURN_ROUNDS = 64


class Instant(NamedTuple):
    """What a clock says of one reading.

    Attributes:
        stamp_ns: When the board sampled; monotonic nanoseconds of the host.
        step_ns: How long after the last accepted reading, on the board's clock; 0 for a reading
            that tells nothing new.
    """

    stamp_ns: int
    step_ns: int


class PolledClock:
    """Stamps of a board that answers requests.

    Without the time of the request a stamp is the moment the answer left the board, with the
    receiving side's jitter in it. With it, the jitter is taken off: the shortest time from a
    request to its answer, of the last 64, is the board's own.

    Args:
        after_ns: The last stamp that was given out, by another clock; 0 for none.
    """

    drift_ppm = 0.0

    def __init__(self, after_ns: int = 0) -> None:
        self._turn_rounds: deque[int] = deque(maxlen=TURN_ROUNDS)
        self._stamp_ns = after_ns

    @property
    def locked(self) -> bool:
        """Whether jitter is being taken off."""
        return len(self._turn_rounds) > 8

    def guess_ns(self, sent_ns: int, requested_ns: int | None = None) -> int:
        """The stamp of a line after a break."""
        return self._stamp(sent_ns, requested_ns)

    def restart(self, sent_ns: int, requested_ns: int | None = None) -> Instant:
        """Go on after a break: the step is the time since the last stamp."""
        self._turn_rounds.clear()
        return self.observe(sent_ns, requested_ns)

    def elapsed_at_most_ns(self, sent_ns: int, requested_ns: int | None = None) -> int:  # noqa: ARG002
        """The longest time that can have passed since the last accepted reading.

        The board sampled before it sent, but it may have heard the request late.
        """
        return sent_ns - self._stamp_ns

    def observe(
        self,
        sent_ns: int,
        requested_ns: int | None = None,
        *,
        ticks: int = 0,  # noqa: ARG002 - what the other clock needs
        least_ns: float = 0.0,
    ) -> Instant:
        """Stamp a reading.

        Args:
            sent_ns: When its line left the board, as far as known.
            requested_ns: When the request was on the board, as far as known.
            ticks: Not used.
            least_ns: The least time that its travel takes: a request that was heard late is
                recognised by it.
        """
        if requested_ns is not None:
            self._turn_rounds.append(sent_ns - requested_ns)
        last_ns = self._stamp_ns
        stamp_ns = self._stamp(sent_ns, requested_ns)
        if last_ns and stamp_ns < last_ns + least_ns:
            stamp_ns = min(sent_ns, last_ns + math.ceil(least_ns))
        if stamp_ns <= last_ns:
            return Instant(last_ns, 0)
        self._stamp_ns = stamp_ns
        return Instant(stamp_ns, stamp_ns - last_ns if last_ns else 0)

    def _stamp(self, sent_ns: int, requested_ns: int | None) -> int:
        if requested_ns is None or not self._turn_rounds:
            return sent_ns
        return min(sent_ns, requested_ns + min(self._turn_rounds))


class StreamedClock:
    """Stamps of a board that renews its totals every ``period_ns`` and sends them at its leisure.

    Args:
        period_ns: The nominal period of the totals.
        after_ns: The last stamp that was given out, by another clock; 0 for none.
    """

    def __init__(self, period_ns: int, after_ns: int = 0) -> None:
        self._period = float(period_ns)
        self._envelope = Envelope(float(period_ns))
        self._arrivals = Arrivals()
        self._base_ns: int | None = None
        self._stamp_ns = after_ns
        self._time = 0.0  # of the current tick, relative to the base
        self._tick = 0  # its number in this run of fast motion
        self._pace = 0.0  # counts a tick, of late; 0 where ticks do not all show
        self._run_start = 0.0  # arrival of the run's tick 0
        self._quiet = 0  # lines since the last change
        self._late_since = 0.0
        self._late_least = math.inf
        self._late_count = 0

    @property
    def locked(self) -> bool:
        """Whether stamps follow the board's ticks rather than the arrival of lines."""
        return self._envelope.settled and self._pace > 0.0

    @property
    def drift_ppm(self) -> float:
        """How much longer the board's tick is than its nominal period, as the host sees it."""
        return self._envelope.drift / self._period * 1e6

    def guess_ns(self, sent_ns: int, requested_ns: int | None = None) -> int:  # noqa: ARG002
        """The stamp of a line after a break: half a tick before it left."""
        return sent_ns - round(0.5 * self._period)

    def restart(self, sent_ns: int, requested_ns: int | None = None) -> Instant:  # noqa: ARG002
        """Go on after a break: the phase is unknown, the step is the time since the last stamp."""
        if self._base_ns is None:
            self._base_ns = sent_ns
        self._arrivals.forget()
        self._pace = 0.0
        self._time = self._arrivals.add(float(sent_ns - self._base_ns)) - 0.5 * self._period
        before_ns = self._stamp_ns
        stamp_ns = self._stamp(self._time, 0.0)
        return Instant(stamp_ns, stamp_ns - before_ns if before_ns else 0)

    def elapsed_at_most_ns(self, sent_ns: int, requested_ns: int | None = None) -> float:  # noqa: ARG002
        """The longest time that can have passed since the last accepted reading: whole ticks."""
        if self._base_ns is None:
            return 0.0
        period = self._period + self._envelope.drift
        late = sent_ns - self._base_ns - self._time
        return max(1, math.floor((late + EARLY_NS) / period)) * period

    def observe(
        self,
        sent_ns: int,
        requested_ns: int | None = None,
        *,
        ticks: int = 0,
        least_ns: float = 0.0,
    ) -> Instant:
        """Stamp a reading.

        Args:
            sent_ns: When its line left the board, as far as known.
            requested_ns: Not used.
            ticks: The largest change of any counter since the last accepted reading.
            least_ns: The least time that this change takes.
        """
        if self._base_ns is None:
            return self.restart(sent_ns, requested_ns)
        arrival = float(sent_ns - self._base_ns)
        left = self._arrivals.add(arrival)
        period = self._period + self._envelope.drift
        if self._pace:
            passed = self._running(arrival, ticks, period)
        else:
            passed = math.floor((left - self._time) / period)
        if ticks:
            passed = max(passed, 0 if self._pace else 1, math.ceil(least_ns / period))
        if passed <= 0:
            return Instant(self._stamp_ns, 0)
        least = max(0.5 * passed * period, least_ns)
        if ticks >= FAST_TICKS * passed:
            self._run(arrival, left, ticks / passed, passed, period)
            stamp_ns = self._stamp(self._time, least)
        else:
            # Ticks do not show one by one: time counts them, and none is told from the next.
            self._pace = 0.0
            self._time = min(self._time + passed * period, left)
            stamp_ns = self._stamp(left - 0.5 * period, least)
        return Instant(stamp_ns, round(passed * period))

    def _stamp(self, time: float, least: float) -> int:
        # Never backwards: where the phase turns out to be earlier, stamps go slower until they fit,
        # but not so slow that a step would look like a jump.
        assert self._base_ns is not None
        slowest_ns = self._stamp_ns + 1 + math.ceil(least)
        self._stamp_ns = max(slowest_ns, self._base_ns + round(time))
        return self._stamp_ns

    def _running(self, arrival: float, ticks: int, period: float) -> int:
        """How many ticks have passed while every tick shows."""
        late = arrival - self._time
        if not ticks:
            # The line repeats a tick, unless even the latest line of a change would be there. One
            # that was held back with many others may be very late and no more than a repeat.
            self._quiet += 1
            still = self._quiet * self._arrivals.gap > QUIET_TICKS * period or late > STALL_NS
            if not still or late <= 2.0 * period + self._arrivals.spread:
                return 0
            return math.floor(late / period) - 1
        self._quiet = 0
        # A skipped tick shows in the counts, and no more can have passed than time allows.
        settled = self._envelope.settled
        early = EARLY_NS if settled else self._arrivals.spread
        passed = max(1, min(math.floor((late + early) / period), round(ticks / self._pace)))
        # Before its tick no line can come: if one does, ticks were counted too high.
        if settled:
            late += EARLY_NS
        else:
            late = arrival - self._run_start - self._tick * period + self._arrivals.spread
        while passed and late < passed * period:
            passed -= 1
        return passed

    def _run(self, arrival: float, left: float, rate: float, passed: int, period: float) -> None:
        """Go on in fast motion, where the ticks can be told apart."""
        envelope = self._envelope
        if self._pace:
            self._pace += 0.5 * (rate - self._pace)
            self._tick += passed
            self._catch_up(arrival, period)
        else:
            # How the ticks of the last run were numbered does not matter to this one.
            self._pace = rate
            self._start_run(arrival)
        envelope.add(self._tick, arrival)
        self._time = envelope.at(self._tick)
        if not envelope.settled:
            # A line shows the newest tick of the moment at which it left.
            self._time = min(max(self._time, left - period), left)

    def _start_run(self, arrival: float) -> None:
        self._tick = 0
        self._run_start = arrival
        self._late_count = 0
        self._envelope.forget()

    def _catch_up(self, arrival: float, period: float) -> None:
        """Notice that ticks were lost without a trace: all lines are late for a long time."""
        late = arrival - self._envelope.at(self._tick)
        if self._late_count == 0:
            self._late_since, self._late_least = arrival, math.inf
        self._late_count += 1
        self._late_least = min(self._late_least, late)
        if arrival - self._late_since >= STEADY_NS and self._late_count >= 8:
            self._late_count = 0
            if self._late_least > 0.75 * period:
                self._start_run(arrival)
