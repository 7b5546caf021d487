"""The second of the two coroutines that share the stream: it gets the counts.

A board that has to be asked is asked on an absolute schedule. A board that streams sends by itself,
and the same schedule only checks that it still does. Either way every reading passes through here
on its way to the odometry, when its last byte arrives, without another iteration of the loop.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import NoReturn

import msgspec

from yahboomd.core.clock import PAUSE_NS, Clock, Schedule, nanoseconds, seconds
from yahboomd.core.errors import BoardSilent
from yahboomd.core.link.tap import NO_TAP, Tap
from yahboomd.core.link.writer import Writer
from yahboomd.core.model import EncoderReading
from yahboomd.core.protocol.dialect import Dialect

REARM_AFTER_S = 0.25
"""A stream that paused for this time is switched on again: the board may have reset unnoticed."""

WATCH_NS = 50_000_000
"""The period of the check that a stream still comes: longer than that of polls."""

ARMED_AFTER_S = 1.0
"""The time after which a frame that switches the stream on has certainly arrived."""

SILENT_AFTER_S = 1.0
"""Without counts for this time the board is gone, although the port works."""


class Poller:
    """Asks for counts, or watches that they come.

    Args:
        writer: Sends the questions.
        clock: The source of time.
        dialect: The dialect of the board.
        period_ns: From poll to poll.
        on_reading: Receives every reading.
        on_armed: Called whenever the board is asked to stream its counts.
        port_name: In messages.
        unbroken: Whether they came before it was asked.
        tap: Notes readings that their bytes do not show whole.

    Attributes:
        unbroken: As given, until the first reading has carried it; then whether the stream ran on
            through a pause of this process.
    """

    def __init__(
        self,
        writer: Writer,
        clock: Clock,
        dialect: Dialect,
        *,
        period_ns: int,
        on_reading: Callable[[EncoderReading], None],
        on_armed: Callable[[], None],
        port_name: str,
        unbroken: bool = False,
        tap: Tap = NO_TAP,
    ) -> None:
        self._writer = writer
        self._clock = clock
        self._dialect = dialect
        self._period_ns = period_ns if dialect.poll is not None else WATCH_NS
        # A slow schedule need not wait its whole period for a lost answer.
        self._answer_ns = min(max(period_ns, 20_000_000), 100_000_000)
        self._on_reading = on_reading
        self._on_armed = on_armed
        self._port_name = port_name
        self._heard_ns = clock.now_ns()
        self._rearmed_ns = 0
        self._after_reset = False
        self._after_gap = True
        self.unbroken = unbroken
        self._ends_by_reset = dialect.poll is None and not dialect.listen_ns
        self._came_ns = 0
        self._tap = tap
        self.counters: Counter[str] = Counter()

    def board_reset(self) -> None:
        """Handle a restart that the board announced: its counters are zero, its stream is off."""
        self._after_reset = True
        self._heard_ns = self._clock.now_ns()
        self.arm()

    def may_have_been_reset(self) -> None:
        """Note words of the board that it sends when it starts."""
        self.unbroken = False
        self._came_ns = 0

    def reading(self, reading: EncoderReading) -> None:
        self._heard_ns = reading.received_ns
        self.counters["readings"] += 1
        noted = reading.requested_ns is not None
        if reading.received_ns - self._came_ns > nanoseconds(REARM_AFTER_S) and not self._after_gap:
            # This process did not run. A stream that was on, and was not switched on since, ran on.
            on_ns = self._came_ns - self._rearmed_ns
            self.unbroken = self._ends_by_reset and on_ns > nanoseconds(ARMED_AFTER_S)
        self._came_ns = reading.received_ns
        if self._after_gap or self._after_reset or self.unbroken:
            noted = True
            reading = msgspec.structs.replace(
                reading,
                after_reset=self._after_reset,
                after_gap=self._after_gap,
                unbroken=self.unbroken,
            )
            self._after_reset = self._after_gap = self.unbroken = False
        if noted:
            self._tap.noted(reading)
        self._on_reading(reading)

    async def run(self) -> NoReturn:
        """Poll, or watch.

        Raises:
            BoardSilent: No counts came for a second.
        """
        self._schedule = Schedule(self._clock, self._period_ns)
        self._heard_ns = self._clock.now_ns()
        await self._schedule.run(self._beat)

    def _beat(self, _: int) -> None:
        schedule = self._schedule
        self.counters["polls_late"] = schedule.missed
        if schedule.late_ns > PAUSE_NS:
            # This process did not run, which is no silence of the board.
            self._heard_ns = max(self._heard_ns, self._clock.now_ns())
            # Nor is the old velocity repeated: the control path decides first.
            return
        self._look()
        if self._dialect.poll is not None and not self._writer.poll(
            self._dialect.poll, self._answer_ns
        ):
            self.counters["polls_skipped"] += 1

    def _look(self) -> None:
        silent_s = seconds(self._clock.now_ns() - self._heard_ns)
        if silent_s <= REARM_AFTER_S:
            return
        if silent_s > SILENT_AFTER_S:
            raise BoardSilent(
                f"{self._port_name}: the board sent no counts for {silent_s:.1f} s.",
                remedy="Is it powered? The port is opened again.",
            )
        since_arm_s = seconds(self._clock.now_ns() - self._rearmed_ns)
        if since_arm_s > REARM_AFTER_S:
            self.counters["rearmed"] += 1
            self.arm()

    def arm(self) -> None:
        """Configure how the board counts, and that it sends its counts."""
        self._rearmed_ns = self._clock.now_ns()
        self._on_armed()
        for frame in self._dialect.arm:
            self._writer.queue(frame)
