"""The last words on a port: brake, look whether the wheels stand, let go, and get it on the wire.

It writes on the port itself, past every queue: whoever was to do it regularly may be dead.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any

import msgspec

from yahboomd.clock import Clock, nanoseconds, seconds, sleep_until
from yahboomd.link.port import Port
from yahboomd.link.standstill import StandstillWatch
from yahboomd.protocol.dialect import Dialect
from yahboomd.protocol.framing import RESYNC
from yahboomd.protocol.registry import CONNECT_SPACING_NS, CONNECT_STOP

STAND_WITHIN_S = 0.6
"""How long a braked wheel may take to stand before it is cut."""

REPEAT_S = 0.1
"""How often the brake is said again meanwhile."""

RUNAWAY_TICKS_PER_S = 200.0
"""A wheel that gains so much while it is braked, and a quarter more than it had, is cut at once."""

DRAIN_S = 0.2


class StopReport(msgspec.Struct, frozen=True, kw_only=True):
    """How a stop went.

    Attributes:
        stood: The counters showed standstill; ``None`` where nobody could see them.
        cut: The motors were let go because they did not obey the brake.
        flushed: Everything was on the wire in the end.
        took_s: From the first stop frame to standstill, or to giving up.
        brakes: How often the brake was said.
    """

    stood: bool | None
    cut: bool
    flushed: bool
    took_s: float
    brakes: int

    @property
    def doubt(self) -> str | None:
        """What keeps one from believing that the wheels stand; ``None`` where nothing does."""
        if not self.flushed:
            return "the port did not take all of it"
        if self.stood is None:
            return "no counts showed whether they stand"
        return None if self.stood else "they still turned when the motors were let go"


async def undisturbed(work: Coroutine[Any, Any, None]) -> None:
    """Finish ``work``, which is bounded in time, however often whoever waits is cancelled."""
    task = asyncio.ensure_future(work)
    disturbance: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError as error:
            disturbance = error
    task.result()
    if disturbance is not None:
        raise disturbance


async def stop_unidentified(port: Port, clock: Clock) -> None:
    """Stop a board whose dialect is not known: what either would obey, after a resync."""
    port.write(RESYNC)
    for frame in CONNECT_STOP:
        port.write(frame)
        await _pause(clock, len(frame) * port.byte_ns + CONNECT_SPACING_NS)


async def bring_to_rest(
    port: Port,
    clock: Clock,
    dialect: Dialect,
    watch: StandstillWatch,
    *,
    verify: bool = True,
    let_go: bool = False,
) -> StopReport:
    """Brake until the counters stand, let the motors go, end the streams, and drain.

    Args:
        port: The open port; what the board says must still reach ``watch``.
        clock: What tells the time.
        dialect: How the board is spoken to.
        watch: Sees the counters.
        verify: Wait for standstill (0.6 s at most); else brake once and let go at once.
        let_go: The motors are without power already: a brake would start the board's speed loop
            again, and whoever let them go may have had a reason.
    """
    brake = (dialect.cut or dialect.brake) if let_go else dialect.brake
    start_ns = clock.now_ns()
    deadline_ns = start_ns + nanoseconds(STAND_WITHIN_S)
    watch.forget()
    # Half a frame may be in the board's ear: inside a frame `$` is data. Newlines clear it.
    port.write(RESYNC + brake)
    brakes = 1
    stood: bool | None = None
    if verify:
        if dialect.cut is not None:
            await _pause(clock, CONNECT_SPACING_NS + 85 * port.byte_ns)
            for frame in dialect.arm:
                port.write(frame)
        brake_due_ns = start_ns + nanoseconds(REPEAT_S)
        first: float | None = None
        while not watch.standing and clock.now_ns() < deadline_ns:
            await _pause(clock, CONNECT_SPACING_NS)
            first = watch.speed if first is None else first
            if dialect.cut is not None and _runs_away(first, watch.speed):
                break
            if clock.now_ns() >= brake_due_ns:
                port.write(brake)
                brakes += 1
                brake_due_ns += nanoseconds(REPEAT_S)
            elif dialect.poll is not None:
                port.write(dialect.poll)
        stood = watch.standing if watch.speed is not None else None
    took_ns = clock.now_ns() - start_ns
    await _pause(clock, CONNECT_SPACING_NS)
    if dialect.cut is not None:
        # Said twice: the first may fall into the answer of what was sent before.
        for frame in (dialect.cut, dialect.cut, *dialect.disarm):
            port.write(frame)
            await _pause(clock, len(frame) * port.byte_ns + CONNECT_SPACING_NS)
    else:
        port.write(dialect.brake)
    flushed = await port.drain(DRAIN_S)
    return StopReport(
        stood=stood,
        cut=stood is not True and dialect.cut is not None,
        flushed=flushed,
        took_s=seconds(took_ns),
        brakes=brakes,
    )


def _runs_away(first: float | None, now: float | None) -> bool:
    """Braking makes it faster: a wheel whose encoder runs backward. Only the cut ends that."""
    return first is not None and now is not None and now > 1.25 * first + RUNAWAY_TICKS_PER_S


async def _pause(clock: Clock, ns: int) -> None:
    await sleep_until(clock, clock.now_ns() + ns)
