"""Pauses of the process, and resets of a simulated board on virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from robot_bench import RobotBench

from yahboomd.core.drive.standing import why
from yahboomd.core.link.port_guard import NO_GUARD, stops_of
from yahboomd.core.link.promise import Promise, memory
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.memory import MemoryPort
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import VirtualTimeLoop, on_virtual_time


def freeze(for_s: float) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.freeze(for_s)


@on_virtual_time
async def test_a_pause_is_one_event_and_counted(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        await asyncio.sleep(1.0)
        assert "paused" not in bench.heard.kinds
        freeze(1.4)
        await asyncio.sleep(1.0)
        (event,) = [event for event in bench.heard.events if event.kind == "paused"]
        assert "yahboomd did not run for 1.4 s" in event.message
        assert bench.controller.status_values()["pauses"] == 1


@on_virtual_time
async def test_wheels_that_the_guard_stopped_in_a_pause_start_again_without_an_alarm(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        promise = bench.guard._promise = Promise(memory())
        await bench.ready()
        await bench.drive(2.0, 0.4)
        now_ns = bench.clock.now_ns()
        assert now_ns // 1_000_000 + 450 < promise.until_ms <= now_ns // 1_000_000 + 1000
        promise.stop = 7
        bench.robot.host_wrote(stops_of(DIALECTS["streamed"])[0], now_ns)
        freeze(1.4)
        # The newest command may be older than the pause.
        await asyncio.sleep(0.3)
        assert promise.acknowledged == 7
        await bench.drive(2.0, 0.4)
        assert min(bench.rim_speeds) > 0.35
        (event,) = [event for event in bench.heard.events if event.kind == "paused"]
        assert event.message.endswith(" Its guard stopped the wheels.")
        assert {each.severity for each in bench.heard.events if each is not event} == {"info"}
        assert bench.controller.status_values()["guard_stops"] == 1


@on_virtual_time
async def test_a_stop_by_the_guard_without_a_pause_is_reported_and_no_jump_follows(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        promise = bench.guard._promise = Promise(memory())
        await bench.ready()
        await bench.drive(2.0, 0.4)
        promise.stop = 1
        bench.robot.host_wrote(stops_of(DIALECTS["streamed"])[0], bench.clock.now_ns())
        await asyncio.sleep(0.05)
        assert "paused" in bench.heard.kinds
        # It ramps up from standstill.
        assert max(bench.controller._wheels.command_m_s) < 0.2
        await bench.drive(1.0, 0.4)
        assert min(bench.rim_speeds) > 0.35


@on_virtual_time
async def test_a_pause_is_noticed_by_the_command_that_waited_for_its_end(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        freeze(1.4)
        bench.command(0.3)
        assert bench.arbiter.counters["after_pause"] == 1
        assert "paused" in bench.heard.kinds


@pytest.mark.cases(1)
@pytest.mark.parametrize("rate_hz", [1, 4, 200])
@on_virtual_time
async def test_a_control_path_that_runs_seldom_is_no_pause(tmp_path: Path, rate_hz: int) -> None:
    overrides = [
        f"command.rate_hz={rate_hz}",
        "command.timeout_s=5",
        'command.sources={"cmd_vel"={priority=10}}',
    ]
    async with RobotBench(tmp_path, overrides) as bench:
        await asyncio.sleep(5.0)
        assert bench.controller.counters["pauses"] == 0


def robot(tmp_path: Path, **simulation: object) -> RobotBench:
    return RobotBench(tmp_path, (), SimulationOptions(**simulation))  # type: ignore[arg-type]


@on_virtual_time
async def test_a_reset_in_motion_is_followed_by_a_second_of_rest(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.robot.reset(bench.clock.now_ns())
        await bench.drive(0.9, 0.3)
        assert bench.standing
        assert "board_reset" in bench.heard.kinds
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(2)
@on_virtual_time
@pytest.mark.parametrize("off_s", [0.0, 0.05, 0.4])
@pytest.mark.parametrize("ticks", [0, 3_000_000])
async def test_a_polled_board_that_resets_without_a_word_gets_its_motor_type_again(
    tmp_path: Path, off_s: float, ticks: int
) -> None:
    async with robot(tmp_path, dialect="polled", initial_ticks=(ticks, 0, ticks, 0)) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        bench.robot.brown_out(bench.clock.now_ns(), off_s)
        await bench.drive(1.5, 0.3)
        if bench.controller.state()[0] == "fault":
            # Counters that began near zero show no reset: a person has to look.
            assert ticks == 0
            await asyncio.sleep(1.0)
            bench.operator.release_estop()
        await bench.drive(2.5, 0.3)
        assert min(bench.rim_speeds) > 0.2


@on_virtual_time
async def test_three_resets_in_ten_seconds_are_a_fault_that_latches(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        for _ in range(3):
            await bench.drive(1.5, 0.3)
            bench.robot.reset(bench.clock.now_ns())
        await bench.drive(4.0, 0.3)
        assert bench.standing
        state, reasons = bench.controller.state()
        assert state == "fault"
        assert "reset itself 3 times" in why(reasons)


@on_virtual_time
async def test_without_a_guard_no_wheel_is_driven_and_that_is_said(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        guard = bench.guard
        guard._start = lambda _: (_ for _ in ()).throw(OSError())
        # A port that closes, in an unplugging perhaps, is no fault of the guard.
        await asyncio.sleep(0.1)
        assert "unguarded" not in bench.heard.kinds
        guard._port = MemoryPort(bench.robot)  # type: ignore[assignment]
        await bench.drive(1.0, 0.4)
        assert max(map(abs, bench.rim_speeds)) == 0.0
        state, reasons = bench.controller.state()
        assert state == "fault"
        assert why(reasons).startswith(NO_GUARD)
        assert bench.heard.kinds.count("unguarded") == 1
        guard._holds = True
        await bench.drive(1.0, 0.4)
        assert min(bench.rim_speeds) > 0.3
