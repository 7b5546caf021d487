"""The age of beats."""

from __future__ import annotations

import asyncio

import pytest

from yahboomd.simulation.virtual_time import LoopClock, VirtualTimeLoop, on_virtual_time
from yahboomd.web.page_commands import KEPT, Beats


@on_virtual_time
async def test_a_beat_is_as_old_as_the_time_since_it_was_made() -> None:
    beats = Beats(LoopClock())
    joined = beats.latest
    first = beats.beat()
    await asyncio.sleep(0.05)
    second = beats.beat()
    await asyncio.sleep(0.2)
    assert beats.age_ns(second, joined) == pytest.approx(200_000_000, abs=1000)
    assert beats.age_ns(first, joined) == pytest.approx(250_000_000, abs=1000)


@on_virtual_time
async def test_a_beat_goes_on_ageing_while_nothing_runs_and_while_the_machine_sleeps() -> None:
    clock = LoopClock()
    beats = Beats(clock)
    joined = beats.latest
    beat = beats.beat()
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.freeze(1.0)
    assert beats.age_ns(beat, joined) == 1_000_000_000
    clock.slept_ns += 60_000_000_000
    assert beats.age_ns(beat, joined) == 61_000_000_000


@on_virtual_time
async def test_beats_of_the_future_of_before_and_of_another_server_are_unknown() -> None:
    beats = Beats(LoopClock())
    start = beats.latest
    before = beats.beat()
    joined = beats.latest
    beat = beats.beat()
    assert beats.age_ns(beat + 1, joined) is None
    assert beats.age_ns(before, joined) is None
    assert beats.age_ns(0, start) is None
    for _ in range(KEPT):
        beats.beat()
    assert beats.age_ns(beat, joined) is None
    assert len({Beats(LoopClock()).latest for _ in range(8)}) == 8
