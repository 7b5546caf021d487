"""When the board sampled its counters.

Law: stamps increase, and none is later than the moment at which its line left the board. Where a
burst of late lines leaves no room between the two, a reading is passed over: its counts are in the
next one as well. Steps are counted in the board's own time.

A board that streams renews its totals on a tick of its own (10 ms) and sends lines at another rate;
between the two lies a USB bridge that may hold bytes back for up to 16 ms. What is certain: a line
with the totals of tick n cannot arrive before tick n. So arrival times, plotted over the number of
the tick, lie above a straight line, whose offset is the phase of the board's clock and whose slope
its true period; the line is found from below (:mod:`yahboomd.odometry.envelope`). Ticks are counted
while the wheels turn fast enough that every tick changes the totals; at rest and at a crawl time
counts them, and stamps are good to a tick.

The period is measured all the time (:mod:`yahboomd.odometry.tick_meter`), since other firmware has
another one. Where none fits, lines are stamped by their arrival.

A board that is asked answers at once: its stamp is the request's time plus the shortest turn-round.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Literal, NamedTuple, TypeAlias

from yahboomd.odometry.arrivals import BREAK_NS as HELD_NS
from yahboomd.odometry.arrivals import Arrivals
from yahboomd.odometry.envelope import Envelope
from yahboomd.odometry.tick_meter import FAST_TICKS, Measured, TickMeter

EARLY_NS = 3_000_000
"""How early a line may come before its tick as it is known; earlier, it was numbered wrongly."""

STEADY_NS = 500_000_000
"""Lines that are late for so long, all of them, have been numbered too low."""

QUIET_TICKS = 1.5
"""Lines without a change are repeats, unless they go on for longer than this."""

SOON = 0.3
"""Counts that change sooner after the last ones, in ticks, wait for the next line."""

AGREE_PERIODS = 2
AGREE_AGAIN = 4
MISFITS = 3
"""So many measurements in a row to believe another period, one after none did fit, and that none
fits."""

TURN_ROUNDS = 64

PROMPT_NS = 20_000_000
"""An answer that took no longer than this over the shortest was prompt: the worst USB latency."""

PROMPT_ANSWERS = 3
"""So many in a row, each to a question of its own, pair answers and questions again."""

PAIRED_NS = 2_000_000
"""Those that took longer than this over the shortest may answer a question of before: such a board
is at work on a backlog, and sampled at any time since the newest question."""


Notice: TypeAlias = Literal["period", "unfit"]


class Instant(NamedTuple):
    """What a clock says of one reading.

    Attributes:
        stamp_ns: When the board sampled; monotonic nanoseconds of the host.
        step_ns: How long after the last accepted reading, on the board's clock; 0 for a reading
            that tells nothing new.
        unsure_ns: How long before its line left the board may have sampled, where that is more than
            an ordinary delay; of a stream, how much shorter the step may have been.
    """

    stamp_ns: int
    step_ns: int
    unsure_ns: int = 0


class PolledClock:
    """Stamps of a board that answers requests.

    Without the time of the request a stamp is the moment the answer left the board, with the
    receiving side's jitter in it. With it, the jitter is taken off: the shortest time from a
    request to its answer, of the last 64, is the board's own.

    Args:
        after_ns: The last stamp that was given out, by another clock; 0 for none.
    """

    drift_ppm = 0.0
    doubt = 0.0
    rough_ns = 0

    def __init__(self, after_ns: int = 0) -> None:
        self._turn_rounds: deque[int] = deque(maxlen=TURN_ROUNDS)
        self._stamp_ns = after_ns
        self._requested_ns: int | None = None
        self._sole = True
        self._prompt = 0

    @property
    def locked(self) -> bool:
        """Whether jitter is being taken off."""
        return len(self._turn_rounds) > 8

    def guess_ns(self, sent_ns: int, requested_ns: int | None = None) -> int:
        """The stamp of a line after a break."""
        return self._stamp(sent_ns, requested_ns)

    def pass_over(self, sent_ns: int) -> None:
        """A line came whose counts are not used."""

    def restart(
        self, sent_ns: int, requested_ns: int | None = None, *, earliest_ns: int | None = None
    ) -> Instant:
        """Go on after a break: the step is the time since the last stamp.

        The board needs as long for an answer as before: the first one after the break may have
        waited for a process that did not run.
        """
        self._prompt = 0
        return self.observe(sent_ns, requested_ns, earliest_ns=earliest_ns)

    def resume(
        self,
        sent_ns: int,
        requested_ns: int | None = None,
        *,
        ticks: int = 0,  # noqa: ARG002 - what the other clock needs
        earliest_ns: int | None = None,
    ) -> Instant:
        """Go on after a gap in which the board went on counting."""
        return self.restart(sent_ns, requested_ns, earliest_ns=earliest_ns)

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
        earliest_ns: int | None = None,
    ) -> Instant:
        """Stamp a reading.

        Args:
            sent_ns: When its line left the board, as far as known.
            requested_ns: When the request was on the board, as far as known.
            ticks: Not used.
            least_ns: The least time that its travel takes: a request that was heard late is
                recognised by it.
            earliest_ns: The board did not sample before; None where that is not known.
        """
        unsure_ns = 0
        if requested_ns is not None:
            unsure_ns = self._unsure(sent_ns, requested_ns, earliest_ns)
        last_ns = self._stamp_ns
        stamp_ns = sent_ns if unsure_ns else self._stamp(sent_ns, requested_ns)
        if last_ns and stamp_ns < last_ns + least_ns:
            stamp_ns = min(sent_ns, last_ns + math.ceil(least_ns))
        if stamp_ns < last_ns + max(1.0, least_ns):
            return Instant(last_ns, 0)
        self._stamp_ns = stamp_ns
        return Instant(stamp_ns, stamp_ns - last_ns if last_ns else 0, unsure_ns)

    def _unsure(self, sent_ns: int, requested_ns: int, earliest_ns: int | None) -> int:
        """How much longer than usual it is not known when the board sampled."""
        turn_rounds, took_ns = self._turn_rounds, sent_ns - requested_ns
        own = requested_ns != self._requested_ns
        self._requested_ns = requested_ns
        sole = own and earliest_ns in (None, requested_ns)
        if self._sole and not sole:
            # A question was not answered in time: which one is answered now is open.
            self._prompt = 0
        self._sole = sole
        shortest_ns = min(turn_rounds, default=took_ns if sole else 0)
        # One that left before the newest question was there answers an earlier one.
        prompt = own and took_ns > 0 and -1_000_000 <= took_ns - shortest_ns <= PROMPT_NS
        self._prompt = self._prompt + 1 if prompt else 0
        paired = self._prompt >= PROMPT_ANSWERS
        if sole or (paired and took_ns - shortest_ns <= PAIRED_NS):
            # Of an answer to another question the turn-round would be too short.
            turn_rounds.append(took_ns)
        elif paired:
            return took_ns - shortest_ns
        if sole or paired or earliest_ns is None:
            earliest_ns = requested_ns
        unsure_ns = sent_ns - earliest_ns - shortest_ns
        return unsure_ns if unsure_ns > PROMPT_NS else 0

    def _stamp(self, sent_ns: int, requested_ns: int | None) -> int:
        if requested_ns is None or not self._turn_rounds:
            return sent_ns
        return min(sent_ns, requested_ns + min(self._turn_rounds))


class StreamedClock:
    """Stamps of a board that renews its totals every ``period_ns`` and sends them at its leisure.

    Args:
        period_ns: The nominal period of the totals.
        after_ns: The last stamp that was given out, by another clock; 0 for none.

    Attributes:
        fits: Whether the board's totals follow a regular tick.
        doubt: By which share of the period the latest measurement disagrees with it.
    """

    def __init__(self, period_ns: int, after_ns: int = 0) -> None:
        self._period = float(period_ns)
        self._envelope = Envelope(float(period_ns))
        self._arrivals = Arrivals()
        self._meter = TickMeter()
        self._base_ns: int | None = None
        self._stamp_ns = after_ns
        self._time = 0.0  # of the current tick, relative to the base
        self._tick = 0  # its number in this run of fast motion
        self._pace = 0.0  # counts a tick, of late; 0 where ticks do not all show
        self._run_start = 0.0  # arrival of the run's tick 0
        self._quiet = 0  # lines since the last change
        self._left_out = 0  # counts of lines that were passed over
        self._late_since = 0.0
        self._late_least = math.inf
        self._late_count = 0
        # Before a silence, where the time of the reading after it is not known: it came in a burst.
        self._adrift: float | None = None
        self._broke = False  # lines stayed away, and how late they are is not settled yet
        self._candidate = 0.0
        self._agreed = 0
        self._misfits = 0
        self._notice: Notice | None = None
        self.doubt = 0.0
        self.fits = True

    @property
    def locked(self) -> bool:
        """Whether stamps follow the board's ticks rather than the arrival of lines."""
        return self._envelope.settled and self._pace > 0.0

    @property
    def drift_ppm(self) -> float:
        """How much longer the board's tick is than its nominal period, as the host sees it."""
        return self._envelope.drift / self._period * 1e6

    @property
    def period_ns(self) -> int:
        """The period of the totals, as far as known."""
        return round(self._period)

    @property
    def rough_ns(self) -> int:
        """Standard deviation of the time of a reading whose tick was not counted.

        Its line may have left at any time within the tick, and have been delayed as others are.
        """
        return round((self._period + self._arrivals.spread) / math.sqrt(12.0))

    def take_notice(self) -> Notice | None:
        """What was found out about the board's tick since the last call."""
        notice, self._notice = self._notice, None
        return notice

    def guess_ns(self, sent_ns: int, requested_ns: int | None = None) -> int:  # noqa: ARG002
        """The stamp of a line after a break: half a tick before it left."""
        return sent_ns - round(0.5 * self._period)

    def pass_over(self, sent_ns: int) -> None:
        """A line came whose counts are not used."""
        if self._base_ns is not None:
            self._arrivals.add(float(sent_ns - self._base_ns))

    def restart(
        self,
        sent_ns: int,
        requested_ns: int | None = None,  # noqa: ARG002
        *,
        earliest_ns: int | None = None,  # noqa: ARG002
    ) -> Instant:
        """Go on after a break: the phase is unknown, the step is the time since the last stamp."""
        if self._base_ns is None:
            self._base_ns = sent_ns
        return self._begin(sent_ns, self._arrivals.add(float(sent_ns - self._base_ns)))

    def _begin(self, sent_ns: int, left: float) -> Instant:
        self._pace = 0.0
        self._left_out = 0
        steady = self._arrivals.steady
        if not steady and self._adrift is None:
            self._adrift = self._time
        self._time = left - 0.5 * self._period
        before_ns = self._stamp_ns
        if before_ns and not steady:
            # It was sampled at some time since the last stamp: that one stays, so that what was
            # travelled since has room behind it.
            step_ns = max(1, sent_ns - before_ns)
            return Instant(before_ns, step_ns, step_ns)
        # No estimate is made of it: where there is no room, the last stamp stays.
        if self._room(sent_ns, 0.0):
            self._stamp(self._time, 0.0, sent_ns)
        step_ns = max(1, self._stamp_ns - before_ns) if before_ns else 0
        return Instant(self._stamp_ns, step_ns)

    def resume(
        self,
        sent_ns: int,
        requested_ns: int | None = None,
        *,
        ticks: int = 0,
        earliest_ns: int | None = None,  # noqa: ARG002 - what the other clock needs
    ) -> Instant:
        """Go on after a gap in which the board went on counting: its ticks did as well.

        Args:
            sent_ns: When the line left the board, as far as known.
            requested_ns: Not used.
            ticks: The largest change of any counter since the last accepted reading.
            earliest_ns: Not used.
        """
        if not self.locked or self._base_ns is None:
            return self.restart(sent_ns, requested_ns)
        left = self._arrivals.add(float(sent_ns - self._base_ns))
        instant = self._judge(sent_ns, left, ticks, 0.0)
        return instant if instant.step_ns else self._begin(sent_ns, left)

    def elapsed_at_most_ns(self, sent_ns: int, requested_ns: int | None = None) -> float:  # noqa: ARG002
        """The longest time that can have passed since the last accepted reading: whole ticks."""
        if self._base_ns is None:
            return 0.0
        period = self._period + self._envelope.drift
        since = self._time if self._adrift is None else self._adrift
        late = sent_ns - self._base_ns - since
        if not self.fits:
            return max(period, late + EARLY_NS)
        return max(1, math.floor((late + EARLY_NS) / period)) * period

    def observe(
        self,
        sent_ns: int,
        requested_ns: int | None = None,
        *,
        ticks: int = 0,
        least_ns: float = 0.0,
        earliest_ns: int | None = None,  # noqa: ARG002 - what the other clock needs
    ) -> Instant:
        """Stamp a reading.

        Args:
            sent_ns: When its line left the board, as far as known.
            requested_ns: Not used.
            ticks: The largest change of any counter since the last accepted reading.
            least_ns: The least time that this change takes.
            earliest_ns: Not used.
        """
        if self._base_ns is None:
            return self.restart(sent_ns, requested_ns)
        left = self._arrivals.add(float(sent_ns - self._base_ns))
        if self._arrivals.steady:
            arrival = float(sent_ns - self._base_ns)
            moved = abs(ticks - self._left_out)
            measured = self._meter.add(arrival, moved, self._arrivals.gap, self._arrivals.spread)
            if measured is not None:
                self._weigh(measured)
        if self._adrift is not None and self._arrivals.steady:
            return self._end_drift(sent_ns, left, ticks, least_ns)
        instant = self._judge(sent_ns, left, ticks, least_ns)
        self._left_out = 0 if instant.step_ns else ticks
        return instant

    def _end_drift(self, sent_ns: int, left: float, ticks: int, least_ns: float) -> Instant:
        """Lines come steadily again; when the last accepted one was sampled is not known."""
        if not self._room(sent_ns, least_ns):
            self._left_out = ticks
            return Instant(self._stamp_ns, 0)
        self._adrift = None
        self._left_out = 0
        self._time = left - 0.5 * self._period
        before_ns = self._stamp_ns
        step_ns = self._stamp(self._time, least_ns, sent_ns) - before_ns
        return Instant(self._stamp_ns, step_ns, step_ns)

    def _judge(self, sent_ns: int, left: float, ticks: int, least_ns: float) -> Instant:
        assert self._base_ns is not None
        arrival = float(sent_ns - self._base_ns)
        period = self._period + self._envelope.drift
        steady = self._arrivals.steady
        self._broke = self._broke or not steady
        room = left - self._time
        none = Instant(self._stamp_ns, 0)
        if self._pace and (steady or self._envelope.settled):
            passed = self._running(arrival, ticks, period)
            if ticks:
                passed = max(passed, math.ceil(least_ns / period))
        elif not steady:
            # How long these lines were held back is not known; they are in the next that is not.
            return none
        elif not self.fits:
            return self._by_arrival(sent_ns, left, ticks, least_ns)
        else:
            passed = math.floor(room / period)
            if ticks and room >= max(SOON * period, least_ns):
                passed = max(passed, 1, math.ceil(least_ns / period))
        if passed <= 0 or not self._room(sent_ns, least_ns):
            return none
        before, running, unsure = self._time, self._pace > 0.0, 0.0
        least = max(0.5 * passed * period, least_ns)
        if ticks >= FAST_TICKS * passed and self.fits:
            timed = self._run(arrival, left, ticks / passed, passed, period)
            counted = passed * period
            step = counted if timed and running else max(least_ns, self._time - before)
            if running and step > counted + period:
                # Time and counts disagree: how long the step took is not known.
                unsure = step - counted
            stamp_ns = self._stamp(self._time, least, sent_ns)
        else:
            # Ticks do not show one by one: time counts them, and no two can be distinguished.
            self._pace = 0.0
            self._time = min(self._time + passed * period, max(left, before))
            step = max(least_ns, self._time - before)
            stamp_ns = self._stamp(left - 0.5 * period, least, sent_ns)
        return Instant(stamp_ns, max(1, round(step)), round(unsure))

    def _by_arrival(self, sent_ns: int, left: float, ticks: int, least_ns: float) -> Instant:
        """Stamp a reading of a board without a tick: its totals were new when the line left."""
        gap = self._arrivals.gap
        room = left - self._time
        wait = max(least_ns, gap * SOON) if ticks else self._still_ns(self._period)
        if room < wait or not self._room(sent_ns, least_ns):
            return Instant(self._stamp_ns, 0)
        self._time = left
        stamp_ns = self._stamp(left - 0.5 * gap, least_ns, sent_ns)
        return Instant(stamp_ns, max(1, round(room)))

    def _room(self, sent_ns: int, least: float) -> bool:
        """Whether a stamp fits between the last one and the moment at which the line left."""
        return sent_ns > self._stamp_ns + least

    def _stamp(self, time: float, least: float, sent_ns: int) -> int:
        # Never backwards: where the phase turns out to be earlier, stamps go slower until they fit,
        # but not so slow that a step would look like a jump.
        assert self._base_ns is not None
        slowest_ns = self._stamp_ns + 1 + math.ceil(least)
        self._stamp_ns = min(max(slowest_ns, self._base_ns + round(time)), sent_ns)
        return self._stamp_ns

    def _still_ns(self, period: float) -> float:
        """After how long without a change the wheels stand."""
        return QUIET_TICKS * max(period, self._meter.spacing)

    def _running(self, arrival: float, ticks: int, period: float) -> int:
        """How many ticks have passed while every tick shows."""
        late = arrival - self._time
        if not ticks:
            # The line repeats a tick, unless even the latest line of a change would be there. One
            # that was held back with many others may be very late and no more than a repeat.
            self._quiet += 1
            still = self._quiet * self._arrivals.gap > self._still_ns(period)
            if not self._arrivals.steady or not (still or self._broke):
                return 0
            if late <= self._still_ns(period) + 0.5 * period + self._arrivals.spread:
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
        if self._broke or not self._arrivals.steady:
            return passed
        # Lines that come steadily are not held back for longer: more ticks have passed than counts
        # tell, as on a board whose tick is longer than it is taken for.
        behind = arrival - self._time - HELD_NS - self._arrivals.spread
        return max(passed, math.floor(behind / period))

    def _run(self, arrival: float, left: float, rate: float, passed: int, period: float) -> bool:
        """Go on in fast motion, where the ticks can be distinguished.

        Returns:
            Whether the ticks were counted; not, where time had to tell how many there were.
        """
        envelope, before = self._envelope, self._time
        timed = True
        if self._pace:
            self._pace += 0.5 * (rate - self._pace)
            self._tick += passed
            timed = self._catch_up(arrival, period)
        else:
            # How the ticks of the last run were numbered does not matter to this one.
            self._pace = rate
            self._start_run(arrival)
        # How late the lines of a backlog are says nothing of the delays of others.
        if self._arrivals.steady or not envelope.settled or arrival < envelope.at(self._tick):
            envelope.add(self._tick, arrival)
        self._time = envelope.at(self._tick)
        if not envelope.settled:
            # A line shows the newest tick of the moment at which it left.
            self._time = min(max(self._time, left - period), left)
            timed = timed and self._time - before <= (passed + 1.0) * period
        return timed

    def _start_run(self, arrival: float) -> None:
        self._tick = 0
        self._run_start = arrival
        self._late_count = 0
        self._envelope.forget()

    def _catch_up(self, arrival: float, period: float) -> bool:
        """Notice that ticks were lost without a trace: all lines are late for a long time.

        Returns:
            Whether time and ticks agree within two ticks.
        """
        late = arrival - self._envelope.at(self._tick)
        if self._broke and self._arrivals.steady:
            # The backlog is over. What is late still was not held back: speed changed meanwhile.
            self._broke = False
            if late > 2.0 * period + self._arrivals.spread:
                self._start_run(arrival)
                return False
        if self._late_count == 0:
            self._late_since, self._late_least = arrival, math.inf
        self._late_count += 1
        self._late_least = min(self._late_least, late)
        if arrival - self._late_since >= STEADY_NS and self._late_count >= 8:
            self._late_count = 0
            if self._late_least > 0.75 * period:
                self._misfits += self._envelope.settled
                self._start_run(arrival)
                return self._late_least <= 2.0 * period
        return True

    # Which tick the board has.

    def _weigh(self, measured: Measured) -> None:
        """Keep the period, change it, or do without."""
        near = abs(measured.period - self._period) <= 0.03 * self._period
        self.doubt = abs(measured.period / self._period - 1.0) if self.fits and not near else 0.0
        if near and self.fits:
            # How straight it is does not matter: delays bend it, and lines that were lost.
            self._agreed = self._misfits = 0
        elif measured.regular and measured.marked:
            period = float(round(measured.period * 1e-6) * 1_000_000)
            self._agreed = self._agreed + 1 if period == self._candidate else 1
            self._candidate = period
            if self._agreed >= (AGREE_PERIODS if self.fits else AGREE_AGAIN):
                self._adopt(period)
        else:
            self._agreed = 0
            self._misfits += 1
        if self._misfits >= MISFITS and self.fits:
            self.fits = False
            self.doubt = 0.0
            self._pace = 0.0
            self._notice = "unfit"

    def _adopt(self, period: float) -> None:
        if period != self._period or not self.fits:
            self._notice = "period"
        self._period = period
        self._envelope = Envelope(period)
        self._pace = 0.0
        self._agreed = self._misfits = 0
        self.doubt = 0.0
        self.fits = True
