"""The fault suite's core on the vendor's firmware 1.7.3: stops, replugs, starvation, a bad line.

Its speed loop needs up to 1.5 s to a standstill where the simulated board's needs 0.2 s, so the
commands are asserted at once and the wheels after that.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from fault_bench import CUT, FaultBench, is_stop
from vendor_firmware import KINDS, ON_THE_FIRMWARE, kinds, of_all

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import VirtualTimeLoop, on_virtual_time

pytestmark = ON_THE_FIRMWARE

MS = 1_000_000
ACCUSED = {
    *("runaway_against", "runaway_fast", "no_counts", "off_speed", "turns_without_command"),
    *("stop_not_obeyed", "board_reset", "disconnected"),
}


def bench_of(folder: Path, motor: str) -> FaultBench:
    return FaultBench(folder, (), SimulationOptions(**KINDS[motor]))


async def estop(bench: FaultBench) -> None:
    bench.operator.engage_estop("a test")


async def lost_bus(bench: FaultBench) -> None:
    bench.controller.bus_lost()


async def end(bench: FaultBench) -> None:
    bench.tasks[0].cancel()
    await asyncio.gather(bench.tasks[0], return_exceptions=True)


Ending = Callable[[FaultBench], Awaitable[None]]


@pytest.mark.parametrize(
    ("ending", "motor"),
    list(zip(itertools.cycle([estop, lost_bus, end]), kinds(2), strict=False)),
)
@on_virtual_time
async def test_a_stop_is_on_the_wire_within_50_ms_and_the_wheels_obey(
    tmp_path: Path, ending: Ending, motor: str
) -> None:
    async with bench_of(tmp_path, motor) as bench:
        await bench.ready()
        await bench.drive(1.5, 0.4)
        at_ns = bench.clock.now_ns()
        await ending(bench)
        await asyncio.sleep(2.0)
        orders = bench.orders_since(at_ns)
        assert is_stop(orders[0][1])
        assert orders[0][0] - at_ns <= 50 * MS
        assert all(is_stop(order) for _, order in orders)
        assert bench.stood_at(at_ns) - at_ns < 1500 * MS
        if ending is end:
            assert orders[-1][1] == CUT
            assert [each.pwm for each in bench.robot.plant.motors] == [0, 0]


@on_virtual_time
async def test_silence_stops_the_wheels_by_the_deadman(tmp_path: Path) -> None:
    async with bench_of(tmp_path, "40 %") as bench:
        await bench.ready()
        await bench.drive(1.5, 0.4)
        at_ns = bench.clock.now_ns()
        await asyncio.sleep(3.0)
        # 50 ms since the last command have passed.
        assert 400 * MS < bench.stood_at(at_ns) - at_ns < 2000 * MS
        assert not ACCUSED & {*bench.heard.kinds}


@pytest.mark.parametrize("away_s", of_all([0.5, 3.0], every=2))
@on_virtual_time
async def test_after_a_replug_the_first_word_is_a_stop_and_it_drives_again(
    tmp_path: Path, away_s: float
) -> None:
    async with bench_of(tmp_path, "44 %, lazy") as bench:
        await bench.ready()
        await bench.drive(1.5, 0.3)
        bench.do(f"unplug {away_s}")
        await bench.drive(away_s, 0.3)
        # A board without a time-out drives on meanwhile.
        assert min(each.speed_m_s for each in bench.robot.plant.motors) > 0.2
        back_ns = bench.clock.now_ns()
        await asyncio.sleep(3.0)
        assert is_stop(bench.orders_since(back_ns - 50 * MS)[0][1])
        assert bench.stood_at(back_ns) - back_ns < 2500 * MS
        await bench.drive(2.0, 0.3)
        assert min(each.speed_m_s for each in bench.robot.plant.motors) > 0.2


@on_virtual_time
async def test_a_brown_out_in_motion_leaves_standing_wheels_until_it_is_over(
    tmp_path: Path,
) -> None:
    async with bench_of(tmp_path, "40 %") as bench:
        await bench.ready()
        await bench.drive(1.5, 0.3)
        bench.do("brown-out 0.3")
        await bench.drive(0.3, 0.3)
        assert max(each.speed_m_s for each in bench.robot.plant.motors) < 0.15
        await bench.drive(4.0, 0.3)
        assert "board_reset" in bench.heard.kinds
        assert min(each.speed_m_s for each in bench.robot.plant.motors) > 0.2
        assert not {"runaway_against", "runaway_fast", "no_counts"} & {*bench.heard.kinds}


@pytest.mark.parametrize("for_s", [0.35, 1.2])
@on_virtual_time
async def test_a_starved_process_accuses_nothing_and_stops_what_ran_out_meanwhile(
    tmp_path: Path, for_s: float
) -> None:
    async with bench_of(tmp_path, "50 %") as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.freeze(for_s)
        thaw_ns = bench.clock.now_ns()
        if for_s > 0.5:
            await asyncio.sleep(2.0)
            (at_ns, order), *_ = bench.orders_since(thaw_ns)
            assert is_stop(order)
            assert at_ns - thaw_ns <= 20 * MS
            assert bench.standing
        else:
            await bench.drive(2.0, 0.3)
            assert min(each.speed_m_s for each in bench.robot.plant.motors) > 0.25
        assert "paused" in bench.heard.kinds
        assert not ACCUSED & {*bench.heard.kinds}


@pytest.mark.parametrize("loss", of_all([0.02, 0.005], every=2))
@on_virtual_time
async def test_a_line_that_loses_bytes_latches_no_fault_and_obeys_an_estop(
    tmp_path: Path, loss: float
) -> None:
    async with bench_of(tmp_path, "35 %, quick") as bench:
        await bench.ready()
        bench.do(f"loss {loss}")
        for vx in (0.3, -0.3, 0.1):
            await bench.drive(1.2, vx)
        assert bench.controller.state()[0] != "fault"
        at_ns = bench.clock.now_ns()
        await estop(bench)
        await asyncio.sleep(3.0)
        assert bench.stood_at(at_ns) - at_ns < 1500 * MS
