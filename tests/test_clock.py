"""The clock: deadlines that ring, schedules that do not drift."""

from __future__ import annotations

import asyncio
import itertools

import pytest

from yahboomd.clock import (
    Clock,
    LoopClock,
    Schedule,
    SystemClock,
    nanoseconds,
    seconds,
    sleep_until,
)

CLOCKS = [SystemClock, LoopClock]


@pytest.fixture(params=CLOCKS, ids=lambda c: c.__name__)
def clock(request: pytest.FixtureRequest) -> Clock:
    return request.param()


def test_seconds_and_nanoseconds_are_each_others_inverse() -> None:
    assert nanoseconds(0.1) == 100_000_000
    assert seconds(nanoseconds(1.25)) == 1.25


async def test_an_alarm_does_not_ring_before_its_deadline(clock: Clock) -> None:
    deadline_ns = clock.now_ns() + 5_000_000
    await sleep_until(clock, deadline_ns)
    # The event loop's own timers may ring up to its resolution early.
    assert clock.now_ns() >= deadline_ns - 1_000_000


async def test_an_alarm_set_in_the_past_rings_at_once(clock: Clock) -> None:
    await asyncio.wait_for(sleep_until(clock, clock.now_ns() - 1_000_000), 10)


async def test_setting_an_alarm_again_replaces_its_deadline(clock: Clock) -> None:
    rings: list[int] = []
    done = asyncio.Event()
    alarm = clock.alarm(lambda: (rings.append(clock.now_ns()), done.set()))  # type: ignore[func-returns-value]
    first_ns = clock.now_ns() + 1_000_000
    alarm.set(first_ns)
    alarm.set(first_ns + 20_000_000)
    await asyncio.wait_for(done.wait(), 10)
    alarm.close()
    assert len(rings) == 1
    assert rings[0] >= first_ns + 19_000_000


async def test_a_cancelled_alarm_never_rings(clock: Clock) -> None:
    rings: list[bool] = []
    alarm = clock.alarm(lambda: rings.append(True))
    alarm.set(clock.now_ns() + 2_000_000)
    alarm.set(None)
    await sleep_until(clock, clock.now_ns() + 10_000_000)
    alarm.close()
    assert rings == []


async def test_a_schedule_keeps_to_start_plus_n_periods(clock: Clock) -> None:
    schedule = Schedule(clock, 2_000_000)
    try:
        due = [await schedule.beat() for _ in range(5)]
    finally:
        schedule.close()
    assert all((b - a) % 2_000_000 == 0 and b > a for a, b in itertools.pairwise(due))


async def test_a_schedule_leaves_out_missed_beats_and_counts_them() -> None:
    clock = SystemClock()
    schedule = Schedule(clock, 2_000_000)
    try:
        first = await schedule.beat()
        # On a busy machine the first beat, too, may have been missed.
        second = first + (schedule.missed + 1) * 2_000_000
        await sleep_until(clock, second + 9_000_000)
        late = await schedule.beat()
        following = await schedule.beat()
    finally:
        schedule.close()
    assert late == second
    assert schedule.missed >= 4
    assert following >= second + 10_000_000
