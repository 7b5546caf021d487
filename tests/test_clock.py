"""The clock: deadlines that ring, schedules that do not drift."""

from __future__ import annotations

import asyncio
import itertools
import os
import resource
import select

import pytest

from yahboomd.core.clock import (
    Clock,
    Pause,
    PauseWatch,
    Schedule,
    SystemClock,
    nanoseconds,
    seconds,
    sleep_until,
)
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time

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


async def test_a_schedule_that_runs_beats_on_time_until_its_callback_fails(clock: Clock) -> None:
    schedule = Schedule(clock, 2_000_000)
    due: list[int] = []

    def beat(due_ns: int) -> None:
        due.append(due_ns)
        if len(due) == 5:
            raise LookupError("the fifth")

    with pytest.raises(LookupError, match="the fifth"):
        await schedule.run(beat)
    assert all((b - a) % 2_000_000 == 0 and b > a for a, b in itertools.pairwise(due))


class Hands:
    """Two clocks that are moved by hand."""

    def __init__(self) -> None:
        self.now = self.slept = 1_000_000_000

    def now_ns(self) -> int:
        return self.now

    def suspended_ns(self) -> int:
        return self.slept


def test_a_process_that_runs_often_enough_has_no_pause() -> None:
    hands = Hands()
    watch = PauseWatch(hands, 300_000_000)  # type: ignore[arg-type]
    for _ in range(10):
        assert watch.detect() is None
        hands.now += 299_000_000


def test_a_gap_between_two_looks_is_a_pause_once() -> None:
    hands = Hands()
    watch = PauseWatch(hands, 300_000_000)  # type: ignore[arg-type]
    watch.detect()
    hands.now += 1_400_000_000
    pause = watch.detect()
    assert pause == Pause(since_ns=1_000_000_000, until_ns=2_400_000_000, suspended_ns=0)
    assert pause.duration_s == 1.4
    assert watch.detect() is None


def test_a_suspend_is_a_pause_although_monotonic_time_stood_still() -> None:
    hands = Hands()
    watch = PauseWatch(hands, 300_000_000)  # type: ignore[arg-type]
    watch.detect()
    hands.slept += 6_000_000_000
    pause = watch.detect()
    assert pause is not None
    assert (pause.suspended_ns, pause.duration_s) == (6_000_000_000, 6.0)
    assert watch.detect() is None


def test_being_held_up_between_two_clocks_is_no_suspend() -> None:
    hands = Hands()
    watch = PauseWatch(hands, 300_000_000)  # type: ignore[arg-type]
    watch.detect()
    for error_ns in (-20_000_000, 0, -200_000_000, 0):
        hands.now += 100_000_000
        hands.slept = 1_000_000_000 + error_ns
        assert watch.detect() is None


def test_a_machine_that_was_never_suspended_says_so_to_the_microsecond() -> None:
    clock = SystemClock()
    # A pair that was read without a delay between the two clocks, or the two readings.
    changes = [abs(clock.suspended_ns() - clock.suspended_ns()) for _ in range(10)]
    assert min(changes) < 1_000_000


@on_virtual_time
async def test_a_schedule_that_rests_keeps_its_grid_and_can_be_woken_to_the_next_beat() -> None:
    clock = LoopClock()
    schedule, due = Schedule(clock, 20_000_000), list[int]()
    start_ns = clock.now_ns()

    def on_beat(due_ns: int) -> None:
        due.append((due_ns - start_ns) // 1_000_000)
        if len(due) < 3:
            schedule.rest(due_ns + 90_000_000)

    beats = asyncio.create_task(schedule.run(on_beat))
    await sleep_until(clock, start_ns + 145_000_000)
    schedule.wake()
    schedule.wake()
    await sleep_until(clock, start_ns + 310_000_000)
    beats.cancel()
    assert due == [20, 120, 160, 180, 200, 220, 240, 260, 280, 300]
    assert schedule.missed == 0


@on_virtual_time
async def test_a_schedule_that_is_advanced_goes_on_at_periods_from_there() -> None:
    clock = LoopClock()
    schedule, due = Schedule(clock, 20_000_000), list[int]()
    start_ns = clock.now_ns()
    schedule.advance(start_ns)
    beats = asyncio.create_task(
        schedule.run(lambda due_ns: due.append((due_ns - start_ns) // 1_000_000))
    )
    for at_ms in (15, 30, 65):
        await sleep_until(clock, start_ns + at_ms * 1_000_000)
        schedule.advance(clock.now_ns())
    await sleep_until(clock, start_ns + 110_000_000)
    beats.cancel()
    assert due == [15, 30, 50, 65, 85, 105]
    assert schedule.missed == 0


async def test_what_is_put_off_wakes_the_loop_at_its_new_deadline_alone() -> None:
    clock, rings = SystemClock(), list[int]()
    alarm = clock.alarm(lambda: rings.append(clock.now_ns()))
    first_ns = clock.now_ns() + 5_000_000
    alarm.set(first_ns)
    alarm.put_off(first_ns + 30_000_000)
    readable, _, _ = select.select([alarm._fd], [], [], 0.02)  # type: ignore[attr-defined]
    assert readable == [] or clock.now_ns() >= first_ns + 30_000_000
    await sleep_until(clock, first_ns + 31_000_000)
    await sleep_until(clock, clock.now_ns() + 1_000_000)
    alarm.close()
    assert len(rings) == 1
    assert rings[0] >= first_ns + 30_000_000


async def test_where_no_descriptor_is_left_an_alarm_rings_all_the_same() -> None:
    clock, rings = SystemClock(), asyncio.Event()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken = os.open("/dev/null", os.O_RDONLY)
    resource.setrlimit(resource.RLIMIT_NOFILE, (taken + 1, hard))
    try:
        filled = [os.dup(taken) for _ in range(_free_below(taken))]
        alarm = clock.alarm(rings.set)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    for each in (taken, *filled):
        os.close(each)
    assert not hasattr(alarm, "_fd")
    alarm.set(clock.now_ns() + 1_000_000)
    await asyncio.wait_for(rings.wait(), 10)
    alarm.close()


def _free_below(limit: int) -> int:
    """How many descriptors below one are free."""
    return limit + 1 - sum(_is_open(each) for each in range(limit + 1))


def _is_open(fd: int) -> bool:
    try:
        os.fstat(fd)
    except OSError:
        return False
    return True
