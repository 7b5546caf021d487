"""Letting motors go until the wheels stand, on virtual time."""

from __future__ import annotations

import asyncio
from typing import Any, cast

import pytest

from yahboomd.core.errors import BoardError
from yahboomd.core.link.line import Line
from yahboomd.core.link.stopping import StandstillWatch
from yahboomd.core.model import NS_PER_S, Counts
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.port.coming_to_rest import CUTS, STAND_WITHIN_S, counts_at_rest


class Wheels:
    """A line that reports a wheel, which turns until it was let go so often."""

    def __init__(self, obeys: int | None) -> None:
        self.clock = LoopClock()
        self.watch = StandstillWatch(100.0)
        self.ticks: Counts = (0, 0, 0, 0)
        self.writer: Any = self
        self.stops: list[tuple[bytes, ...]] = []
        self._obeys = obeys
        self._counting = asyncio.ensure_future(self._count())

    def stop(self, frames: tuple[bytes, ...]) -> None:
        self.stops.append(frames)

    async def _count(self) -> None:
        while True:
            await asyncio.sleep(0.01)
            if self._obeys is None or len(self.stops) < self._obeys:
                self.ticks = (self.ticks[0] + 10, 0, 0, 0)
            self.watch.add(self.ticks, self.clock.now_ns())

    async def rest(self, check: Any = lambda: None) -> Counts | None:
        line = cast(Line, self)
        try:
            return await counts_at_rest(
                line,
                DIALECTS["streamed"],
                still_ticks_per_s=100.0,
                check=check,
            )
        finally:
            self._counting.cancel()


@on_virtual_time
async def test_motors_are_let_go_again_until_every_wheel_is_seen_to_stand() -> None:
    wheels = Wheels(obeys=3)
    assert await wheels.rest() == wheels.ticks
    assert len(wheels.stops) == 3
    assert wheels.stops[0] == (DIALECTS["streamed"].cut,) * CUTS


@on_virtual_time
async def test_a_wheel_that_turns_on_is_given_up_in_time() -> None:
    wheels = Wheels(obeys=None)
    begun_ns = wheels.clock.now_ns()
    assert await wheels.rest() is None
    assert wheels.clock.now_ns() - begun_ns == pytest.approx(STAND_WITHIN_S * NS_PER_S, abs=2e7)


@on_virtual_time
async def test_what_the_check_finds_ends_the_wait() -> None:
    def reset() -> None:
        raise BoardError("The board reset itself.")

    wheels = Wheels(obeys=None)
    with pytest.raises(BoardError):
        await wheels.rest(reset)
    assert wheels.stops == []
