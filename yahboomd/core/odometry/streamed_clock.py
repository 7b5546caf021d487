"""When a board that streams sampled its counters.

Law: stamps increase, and none is later than the moment at which its line left the board. If a burst
of late lines leaves no room between the two, a reading is skipped: the next one contains its
counts. Steps are measured in the board's own time.

A board that streams renews its totals on a tick of its own (10 ms) and sends lines at another rate,
through a USB bridge that may hold bytes back for up to 16 ms. But a line
with the totals of tick n cannot arrive before tick n. So arrival times, plotted over the number of
the tick, lie above a straight line, whose offset is the phase of the board's clock and whose slope
is its true period; the line is fitted from below (:mod:`yahboomd.core.odometry.envelope`). Ticks
are counted while the wheels turn fast enough that every tick changes the totals; at rest and at a
crawl they follow from time, and stamps are good to a tick.

The period is measured all the time (:mod:`yahboomd.core.odometry.tick_meter`), because other
firmware has another one. If none fits, lines are stamped by their arrival.
"""

from __future__ import annotations

import math

from yahboomd.core.model import EncoderReading
from yahboomd.core.odometry.arrivals import BREAK_NS as HELD_NS
from yahboomd.core.odometry.arrivals import Arrivals
from yahboomd.core.odometry.envelope import Envelope
from yahboomd.core.odometry.line_age import LineAge
from yahboomd.core.odometry.polled_clock import Instant
from yahboomd.core.odometry.tick_meter import FAST_TICKS, TickMeter, TickPeriod

EARLY_NS = 3_000_000
"""The most that a line may come before its tick; an earlier one was numbered wrongly."""

STEADY_NS = 500_000_000
"""Lines that are all late for this time were numbered too low."""

QUIET_TICKS = 1.5
"""Lines without a change are repeats, unless they go on for longer than this."""

COUNTED_TICKS = 50
"""Over a longer gap the pace of the counts does not tell how many ticks have passed."""

SKIPPED_TICKS = 3.5
"""A step within a backlog that spans more ticks follows lines that were dropped."""

SOON = 0.3
"""Counts that change sooner than this after the last ones, in ticks, wait for the next line."""

LATE, EVENLY = 13_000_000, 0.7
"""Without a tick, a line this much later than usual waited, or lines before it were lost. It is
passed over, as are the lines behind it that come closer than this share of the usual distance."""


class StreamedClock:
    """Stamps of a board that renews its totals every ``period_ns`` and sends them at another rate.

    Args:
        period_ns: The nominal period of the totals.
        after_ns: The last stamp of another clock; 0 for none.
        each_line: The totals are new with each line, and a line comes every ``period_ns``: there is
            no tick to look for, and stamps follow the lines.
        age_ns: With ``each_line``, how old the totals of a line may be when it leaves.

    Attributes:
        renewal: How often the totals are renewed, as far as known.
    """

    __slots__ = (
        "renewal _each_line _age _lines _envelope _arrivals _meter _base_ns _stamp_ns _time "
        "_tick _pace _run_start _quiet _left_out _late_since _late_least _late_count _adrift "
        "_broke _held _heard _left _arrived"
    ).split()

    def __init__(
        self, period_ns: int, after_ns: int = 0, *, each_line: bool = False, age_ns: int = 0
    ) -> None:
        self.renewal = TickPeriod(float(period_ns))
        self.renewal.fits = not each_line
        self._each_line = each_line
        self._age = float(age_ns)
        self._lines = LineAge(period_ns, age_ns) if each_line and age_ns else None
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
        self._left_out = 0  # counts of lines that were skipped
        self._late_since = 0.0
        self._late_least = math.inf
        self._late_count = 0
        # Time before a silence, if the reading after it came in a burst and its time is unknown.
        self._adrift: float | None = None
        self._broke = False  # lines were missing, and their delay is not known yet
        self._held, self._heard = False, 0  # a line that came late, and when the last one came
        self._left = 0.0  # when the line left that `fresh` took in, before it is stamped
        self._arrived = False

    @property
    def locked(self) -> bool:
        """Whether stamps follow the board's ticks rather than the arrival of lines."""
        return self._envelope.settled and bool(self._pace)

    @property
    def unseen_ns(self) -> float:
        """The period of a timer that renews the totals, unless the lines have shown it already."""
        seen = self._lines is None or self._lines.step_ns is not None
        return 0.0 if seen else self._age

    @property
    def rough_ns(self) -> int:
        """Standard deviation of the time of a reading whose tick was not counted.

        Its line may have left at any time within the tick, and have been delayed as others are.
        """
        return round((self.renewal.period + self._arrivals.spread) / math.sqrt(12.0))

    def guess_ns(self, reading: EncoderReading) -> int:
        """The stamp of a line after a break: half a tick before it left."""
        return reading.sent_ns - round(self._behind(self.renewal.period))

    def _behind(self, period: float) -> float:
        """How far a line's stamp lies behind the line while no tick shows."""
        return 0.5 * (self._age if self._each_line else period)

    def fresh(self, reading: EncoderReading) -> bool:
        """Whether a line just left, and did not wait in a backlog. It is passed in once more."""
        if self._base_ns is None:
            return True
        self._left, self._arrived = self._arrive(reading), True
        return self._arrivals.steady

    def _arrive(self, reading: EncoderReading) -> float:
        assert self._base_ns is not None
        if self._arrived:
            self._arrived = False
            return self._left
        wire = float(reading.received_ns - reading.sent_ns)
        return self._arrivals.add(float(reading.sent_ns - self._base_ns), wire)

    def pass_over(self, reading: EncoderReading) -> None:
        """Note a line whose counts are not used."""
        if self._base_ns is not None:
            self._arrive(reading)

    def restart(self, reading: EncoderReading) -> Instant:
        """Continue after a break, phase unknown: the step is the time since the last stamp."""
        sent_ns = reading.sent_ns
        if self._base_ns is None:
            self._base_ns = sent_ns
        return self._begin(sent_ns, self._arrive(reading))

    def _begin(self, sent_ns: int, left: float) -> Instant:
        self._pace = 0.0
        self._left_out = 0
        if self._lines is not None:
            self._lines.forget()
        steady = self._arrivals.steady
        if not steady and self._adrift is None:
            self._adrift = self._time
        self._time = left - self._behind(self.renewal.period)
        before_ns = self._stamp_ns
        if before_ns and not steady:
            # It was sampled at some time since the last stamp, which stays: the travel since then
            # needs room behind it.
            step_ns = max(1, sent_ns - before_ns)
            return Instant(before_ns, step_ns, step_ns)
        # It gives no estimate: without room, the last stamp stays.
        if self._room(sent_ns, 0.0):
            self._stamp(self._time, 0.0, sent_ns)
        step_ns = max(1, self._stamp_ns - before_ns) if before_ns else 0
        return Instant(self._stamp_ns, step_ns)

    def resume(self, reading: EncoderReading, *, ticks: int) -> Instant:
        """Continue after a gap in which the board, and so its ticks, kept counting.

        Args:
            reading: The first after the gap.
            ticks: The largest change of any counter since the last accepted reading.
        """
        if not self.locked or self._base_ns is None or ticks > COUNTED_TICKS * self._pace:
            return self.restart(reading)
        sent_ns = reading.sent_ns
        left = self._arrive(reading)
        instant = self._judge(sent_ns, left, ticks, 0.0)
        return instant if instant.step_ns else self._begin(sent_ns, left)

    def elapsed_at_most_ns(self, reading: EncoderReading) -> float:
        """The longest time that can have passed since the last accepted reading: whole ticks."""
        if self._base_ns is None:
            return 0.0
        period = self.renewal.period + self._envelope.drift
        since = self._time if self._adrift is None else self._adrift
        late = reading.sent_ns - self._base_ns - since
        if not self.renewal.fits:
            return max(period, late + EARLY_NS)
        return max(1, math.floor((late + EARLY_NS) / period)) * period

    def observe(self, reading: EncoderReading, *, ticks: int = 0, least_ns: float = 0.0) -> Instant:
        """Stamp a reading.

        Args:
            reading: The reading; only the time at which its line left the board matters.
            ticks: The largest change of any counter since the last accepted reading.
            least_ns: The least time that this change takes.
        """
        if self._base_ns is None:
            return self.restart(reading)
        sent_ns = reading.sent_ns
        arrival = float(sent_ns - self._base_ns)
        left = self._arrive(reading)
        if self._arrivals.steady and not self._each_line:
            moved = abs(ticks - self._left_out)
            measured = self._meter.add(arrival, moved, self._arrivals.gap, self._arrivals.spread)
            if measured is not None and self.renewal.weigh(measured):
                self._pace = 0.0
                if self.renewal.fits:
                    self._envelope = Envelope(self.renewal.period)
        if self._adrift is not None and self._arrivals.steady:
            return self._end_drift(sent_ns, left, ticks, least_ns)
        instant = self._judge(sent_ns, left, ticks, least_ns)
        self._left_out = 0 if instant.step_ns else ticks
        return instant

    def _end_drift(self, sent_ns: int, left: float, ticks: int, least_ns: float) -> Instant:
        """Lines come steadily again; the sampling time of the last accepted one is unknown."""
        if not self._room(sent_ns, least_ns):
            self._left_out = ticks
            return Instant(self._stamp_ns, 0)
        self._adrift = None
        self._left_out = 0
        self._time = left - self._behind(self.renewal.period)
        before_ns = self._stamp_ns
        step_ns = self._stamp(self._time, least_ns, sent_ns) - before_ns
        return Instant(self._stamp_ns, step_ns, step_ns)

    def _judge(self, sent_ns: int, left: float, ticks: int, least_ns: float) -> Instant:
        assert self._base_ns is not None
        arrival = float(sent_ns - self._base_ns)
        period = self.renewal.period + self._envelope.drift
        steady = self._arrivals.steady
        self._broke = self._broke or not steady
        room = left - self._time
        none = Instant(self._stamp_ns, 0)
        if self._pace and (steady or self._envelope.settled):
            if not steady and ticks > SKIPPED_TICKS * self._pace:
                # Lines that a backlog lost may have taken longer than its counts show.
                return none
            passed = self._running(arrival, ticks, period)
            if ticks:
                passed = max(passed, math.ceil(least_ns / period))
        elif not steady:
            # The delay of these lines is unknown; the next steady line contains their counts.
            if self._lines is not None:
                self._lines.forget()
            return none
        elif not self.renewal.fits:
            return self._by_arrival(sent_ns, left, ticks, least_ns)
        else:
            passed = math.floor(room / period)
            if ticks and room >= max(SOON * period, least_ns):
                passed = max(passed, 1, math.ceil(least_ns / period))
        if passed <= 0 or not self._room(sent_ns, least_ns):
            return none
        before, running, unsure = self._time, bool(self._pace), 0.0
        least = max(0.5 * passed * period, least_ns)
        if ticks >= FAST_TICKS * passed and self.renewal.fits:
            timed = self._run(arrival, left, ticks / passed, passed, period)
            counted = passed * period
            step = counted if timed and running else max(least_ns, self._time - before)
            if running and step > counted + period:
                # Time and counts disagree: the length of the step is unknown.
                unsure = step - counted
            stamp_ns = self._stamp(self._time, least, sent_ns)
        else:
            # Ticks do not show one by one: they follow from time, and no two can be distinguished.
            self._pace = 0.0
            self._time = min(self._time + passed * period, max(left, before))
            step = max(least_ns, self._time - before)
            stamp_ns = self._stamp(left - 0.5 * period, least, sent_ns)
        return Instant(stamp_ns, max(1, round(step)), round(unsure))

    def _by_arrival(self, sent_ns: int, left: float, ticks: int, least_ns: float) -> Instant:
        """Stamp a reading of a board without a tick.

        If each line brings new totals they were sampled for it; else at any time since the last.
        """
        gap = self._arrivals.gap
        apart, self._heard = sent_ns - self._heard, sent_ns
        self._held = apart > gap + LATE or (self._held and apart < EVENLY * gap)
        room = left - self._time
        wait = max(least_ns, gap * SOON) if ticks else self._still_ns(self.renewal.period)
        if (self._held and not self._each_line) or room < wait or not self._room(sent_ns, least_ns):
            return Instant(self._stamp_ns, 0)
        self._time = left
        lines, moment, step = self._lines, left - self._behind(gap), room
        if lines is not None:
            lines.add(left, abs(ticks))
            if lines.age_ns is not None and lines.moment is not None:
                moment = min(left, lines.moment - lines.age_ns)
            step = room if lines.step_ns is None else lines.step_ns
        stamp_ns = self._stamp(moment, least_ns, sent_ns)
        return Instant(stamp_ns, max(1, round(step)))

    def _room(self, sent_ns: int, least: float) -> bool:
        """Whether a stamp fits between the last one and the moment at which the line left."""
        return sent_ns > self._stamp_ns + least

    def _stamp(self, time: float, least: float, sent_ns: int) -> int:
        # Never backwards: if the phase turns out to be earlier, stamps go slower until they fit,
        # but not below the least time of a step, which would look like a jump.
        assert self._base_ns is not None
        slowest_ns = self._stamp_ns + 1 + math.ceil(least)
        self._stamp_ns = min(max(slowest_ns, self._base_ns + round(time)), sent_ns)
        return self._stamp_ns

    def _still_ns(self, period: float) -> float:
        """The time without a change after which the wheels stand."""
        return QUIET_TICKS * max(period, self._meter.spacing)

    def _running(self, arrival: float, ticks: int, period: float) -> int:
        late = arrival - self._time
        if not ticks:
            # The line repeats a tick, unless even the latest line of a change would be there. A
            # line that was held back with many others may be a very late repeat.
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
        # No line can come before its tick: if one does, ticks were counted too high.
        if settled:
            late += EARLY_NS
        else:
            late = arrival - self._run_start - self._tick * period + self._arrivals.spread
        while passed and late < passed * period:
            passed -= 1
        if self._broke or not self._arrivals.steady:
            return passed
        # Steady lines are not held back for longer: more ticks have passed than the counts show, as
        # on a board whose tick is longer than assumed.
        behind = arrival - self._time - HELD_NS - self._arrivals.spread
        return max(passed, math.floor(behind / period))

    def _run(self, arrival: float, left: float, rate: float, passed: int, period: float) -> bool:
        """Continue fast motion, in which the ticks can be distinguished.

        Returns:
            Whether the ticks were counted, and not derived from time.
        """
        envelope, before = self._envelope, self._time
        timed = True
        if self._pace:
            self._pace += 0.5 * (rate - self._pace)
            self._tick += passed
            timed = self._catch_up(arrival, period)
        else:
            # The numbering of the last run does not matter to this one.
            self._pace = rate
            self._start_run(arrival)
        # The delays of a backlog's lines do not represent those of others.
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
        self._envelope.reset()

    def _catch_up(self, arrival: float, period: float) -> bool:
        """Detect ticks that were lost without a trace: all lines are late for a long time.

        Returns:
            Whether time and ticks agree within two ticks.
        """
        late = arrival - self._envelope.at(self._tick)
        if self._broke and self._arrivals.steady:
            # The backlog is over. A late line was not held back: the speed changed meanwhile.
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
                if self._envelope.settled:
                    self.renewal.misfit()
                self._start_run(arrival)
                return self._late_least <= 2.0 * period
        return True
