"""Lets the motors go until every wheel is seen to stand, on a line that stays in use."""

from __future__ import annotations

from collections.abc import Callable

from yahboomd.core.clock import nanoseconds, sleep_until
from yahboomd.core.link.line import Line
from yahboomd.core.model import Counts
from yahboomd.core.protocol.dialect import Dialect

CUTS = 3
"""How often each cut is sent, because a frame may be lost. Cuts repeat until the wheels stand."""

STAND_WITHIN_S = 3.0
REPEAT_NS = 100_000_000
LOOK_NS = 10_000_000

OBEYED_NS = 500_000_000
"""A wheel that still turns after this time may be one of a board that ignores a cut."""

HELD_UP_NS = 100_000_000
"""A wait that ends this late means that the process did not run."""


def cut(line: Line, dialect: Dialect) -> None:
    """Let the motors go; a dialect without a cut brakes instead."""
    line.writer.stop((dialect.cut or dialect.brake,) * CUTS)


async def counts_at_rest(
    line: Line, dialect: Dialect, *, still_ticks_per_s: float, check: Callable[[], None]
) -> Counts | None:
    """Cut until every wheel stands; the counters then, or None if one does not.

    A Rosmaster of some car types ignores a cut: half a second later it gets the surest stop.

    Args:
        still_ticks_per_s: Below it a wheel counts as standing.
        check: Raises what ends the wait; is called at each look.
    """
    clock = line.clock
    line.watch.reset()
    begun_ns = clock.now_ns()
    end_ns, again_ns = begun_ns + nanoseconds(STAND_WITHIN_S), begun_ns + REPEAT_NS
    while (speed := line.watch.speed) is None or speed >= still_ticks_per_s:
        check()
        now_ns = clock.now_ns()
        if now_ns >= end_ns:
            return None
        if now_ns >= again_ns:
            early = now_ns - begun_ns < OBEYED_NS
            line.writer.stop(((early and dialect.cut) or dialect.surest_stop,) * CUTS)
            again_ns = now_ns + REPEAT_NS
        await sleep_until(clock, now_ns + LOOK_NS)
        # Time in which this process did not run is no proof of a turning wheel.
        end_ns += max(0, clock.now_ns() - now_ns - HELD_UP_NS)
    return line.ticks
