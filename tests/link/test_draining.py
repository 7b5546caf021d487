from __future__ import annotations

import os

from yahboomd.clock import LoopClock
from yahboomd.link.draining import drained, in_kernel
from yahboomd.simulation.virtual_time import on_virtual_time

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
async def test_it_gives_up_in_time_where_nobody_takes_the_output() -> None:
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
