from __future__ import annotations

import os

import pytest

from yahboomd.core.link.draining import STUCK_NS, OutputWatch, drained, in_kernel
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time

BYTE_NS = 86_806


def test_a_descriptor_that_is_gone_holds_nothing() -> None:
    master, slave = os.openpty()
    assert in_kernel(slave) == 0
    os.close(master)
    os.close(slave)
    assert in_kernel(slave) == 0


@on_virtual_time
async def test_it_waits_as_long_as_the_bytes_take_and_no_longer() -> None:
    clock = LoopClock()
    begin_ns = clock.now_ns()

    def waiting() -> int:
        return max(0, 100 - (clock.now_ns() - begin_ns) // BYTE_NS)

    assert await drained(clock, waiting, byte_ns=BYTE_NS, timeout_s=1.0)
    assert 100 * BYTE_NS <= clock.now_ns() - begin_ns < 103 * BYTE_NS


@on_virtual_time
async def test_it_gives_up_in_time_where_the_output_is_not_taken() -> None:
    clock = LoopClock()
    begin_ns = clock.now_ns()
    assert not await drained(clock, lambda: 7, byte_ns=BYTE_NS, timeout_s=0.2)
    assert 200_000_000 <= clock.now_ns() - begin_ns < 200_000_000 + BYTE_NS


@on_virtual_time
async def test_a_lost_port_is_not_waited_for() -> None:
    clock = LoopClock()
    begin_ns = clock.now_ns()
    assert not await drained(clock, lambda: None, byte_ns=BYTE_NS, timeout_s=0.2)
    assert clock.now_ns() == begin_ns


def test_a_time_in_which_this_process_did_not_run_shows_neither_a_slow_nor_a_stuck_port() -> None:
    waiting = [20]
    watch = OutputWatch(lambda: waiting[0], byte_ns=86_806)
    for left in (20, 0):
        watch.wrote(20, 1_000_000_000)
        waiting[0] = 20
        assert watch.holds(1_001_000_000)
        waiting[0] = left
        assert watch.holds(2_500_000_000) == bool(left)
        assert not watch.stuck(2_500_000_000)
        assert watch.slow_bytes_per_s is None
        watch.holds(2_501_000_000)
    # Without a pause it shows both.
    waiting[0] = 20
    watch.wrote(20, 3_000_000_000)
    for n in range(400):
        watch.holds(3_000_000_000 + n * 1_000_000)
    assert watch.stuck(3_400_000_000)
    waiting[0] = 0
    watch.holds(3_401_000_000)
    assert watch.slow_bytes_per_s == pytest.approx(50, rel=0.01)


def test_a_port_that_sends_nothing_for_300_ms_is_stuck_and_one_that_sends_a_byte_is_not() -> None:
    left = [20]
    watch = OutputWatch(lambda: left[0], BYTE_NS)
    watch.wrote(20, 0)
    assert watch.holds(1_000_000)
    assert not watch.stuck(STUCK_NS)
    assert watch.stuck(1_000_000 + STUCK_NS)
    left[0] = 19
    assert watch.holds(2 * STUCK_NS)
    assert not watch.stuck(2 * STUCK_NS + 1)
    left[0] = 0
    assert not watch.holds(3 * STUCK_NS)
    assert not watch.stuck(9 * STUCK_NS)


def test_the_rate_of_a_slow_port_is_measured_and_an_ordinary_one_is_not_called_slow() -> None:
    left = [20]
    watch = OutputWatch(lambda: left[0], BYTE_NS)
    watch.wrote(20, 0)
    watch.holds(2_000_000)
    left[0] = 0
    watch.holds(4_000_000)
    assert watch.slow_bytes_per_s is None
    left[0] = 20
    watch.wrote(20, 0)
    watch.holds(2_000_000)
    left[0] = 0
    watch.holds(200_000_000)
    assert watch.slow_bytes_per_s == 100.0
