"""Sources compete: old commands move nothing, and the status explains why the robot stands."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from fault_bench import DIALECTS, MS, FaultBench, first_stop_ns, is_stop
from robot_bench import state_and_why

from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    return FaultBench(tmp_path, overrides, SimulationOptions(**simulation))  # type: ignore[arg-type]


def stamped(bench: FaultBench, vx: float, ago_s: float = 0.0) -> bytes:
    return json.dumps({"vx": vx, "stamp_ns": bench.clock.wall_ns() - round(ago_s * 1e9)}).encode()


@pytest.mark.parametrize("with_stamps", [True, False])
@on_virtual_time
async def test_a_backlog_of_200_commands_in_4_ms_moves_nothing(
    tmp_path: Path, with_stamps: bool
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        if with_stamps:
            bench.payload(stamped(bench, 0.0))
        await asyncio.sleep(3.0)
        before = bench.robot.plant.ticks
        for number in range(200):
            ago_s = 4.0 - number * 0.02
            bench.payload(stamped(bench, 0.5, ago_s) if with_stamps else b'{"vx": 0.5}')
            await asyncio.sleep(0.000_02)
        since_ns = bench.clock.now_ns()
        await asyncio.sleep(1.0)
        assert bench.robot.plant.ticks == before
        assert all(is_stop(order) for _, order in bench.orders_since(since_ns + 25 * MS))
        facts = bench.intake.status_values()
        assert facts.get("stale", 0) + facts.get("backlog", 0) >= 150
        # The next fresh command is obeyed all the same.
        await bench.drive(0.5, 0.3)
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(1)
@pytest.mark.parametrize(("on_timeout", "ramps"), [("ramp", True), ("halt", False)])
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_silence_slows_the_wheels_down_within_its_timeout_and_one_control_period(
    tmp_path: Path, dialect: str, on_timeout: str, ramps: bool
) -> None:
    worst_ms = 0.0
    async with robot(tmp_path, f"command.on_timeout={on_timeout}", dialect=dialect) as bench:
        await bench.ready()
        for phase_ms in range(0, 60, 13):
            await bench.drive(0.5, 0.4)
            await asyncio.sleep(phase_ms / 1000)
            bench.command(0.4)
            given_ns = bench.clock.now_ns()
            await asyncio.sleep(0.9)
            orders = bench.orders_since(given_ns)
            full = orders[0][1]
            slower = next((at_ns, order) for at_ns, order in orders if order != full)
            worst_ms = max(worst_ms, (slower[0] - given_ns) / MS - 500.0)
            assert is_stop(slower[1]) != ramps
            # 0.4 m/s at 5 m/s^2, and the line.
            assert (first_stop_ns(orders) - slower[0]) / MS < 120.0
        print(f"{dialect}, {on_timeout}: slower {worst_ms:.1f} ms after the timeout, at worst")
        assert worst_ms <= 20.5


@on_virtual_time
async def test_status_names_every_reason_to_stand(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        assert "No board yet" in state_and_why(bench.controller)[1]
        await bench.ready()
        assert state_and_why(bench.controller) == ("standing", "No source commands motion.")
        await bench.drive(0.5, 0.3)
        state, why = state_and_why(bench.controller)
        assert (state, why) == ("driving", "cmd_vel drives.")
        assert bench.controller.decision.since_ns is not None
        await asyncio.sleep(1.5)
        assert "cmd_vel fell silent" in state_and_why(bench.controller)[1]
        bench.operator.engage_estop("somebody")
        bench.do("mute 5")
        await asyncio.sleep(0.5)
        state, why = state_and_why(bench.controller)
        assert state == "estopped"
        for reason in ("engaged by somebody", "No counts have come", "fell silent"):
            assert reason in why


def copies(bench: FaultBench, command: bytes, times: int) -> None:
    """One command, delivered several times, as the ROS 2 bridge may do."""
    arrival = Arrival(
        key="cmd_vel", payload=command, stamp_ns=None, arrived_ns=bench.clock.now_ns()
    )
    bench.intake.handler("cmd_vel")([arrival] * times)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("times", [1, 8, 32])
@on_virtual_time
async def test_no_release_starts_the_wheels_however_often_each_command_is_delivered(
    tmp_path: Path, times: int, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.operator.engage_estop("somebody")
        for n in range(100):
            copies(bench, b'{"vx": 0.3}', times)
            # At every phase between two commands, from the first one on.
            await asyncio.sleep(0.001 * (n % 50))
            released, why = bench.operator.release_estop()
            assert not released
            assert "cmd_vel commands motion" in why
            await asyncio.sleep(0.001 * (50 - n % 50))
        assert bench.standing
        await asyncio.sleep(1.0)
        assert bench.operator.release_estop()[0]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_no_release_starts_the_wheels_just_after_a_silent_board_came_back(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.operator.engage_estop("somebody")
        bench.do("mute 3")
        for _ in range(200):
            bench.command(0.3)
            for _ in range(10):
                await asyncio.sleep(0.005)
                assert not bench.operator.release_estop()[0]
        assert bench.events("connected")[1:]
        assert bench.standing


@on_virtual_time
async def test_a_command_that_arrived_before_a_release_and_is_handled_after_it_moves_nothing(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        bench.operator.engage_estop("somebody")
        await asyncio.sleep(1.0)
        arrived_ns = bench.clock.now_ns()
        await asyncio.sleep(0.001)
        assert bench.operator.release_estop()[0]
        waited = Arrival(
            key="cmd_vel", payload=b'{"vx": 0.3}', stamp_ns=None, arrived_ns=arrived_ns
        )
        bench.intake.handler("cmd_vel")([waited])
        assert bench.arbiter.current(bench.clock.now_ns()).twist.is_zero
        await asyncio.sleep(0.5)
        assert bench.standing
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


@on_virtual_time
async def test_a_fault_is_not_cleared_within_a_second_of_a_refused_command(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.do("encoder-dead left")
        await bench.drive(1.0, 0.3)
        assert bench.controller.state()[0] == "fault"
        await asyncio.sleep(2.0)
        copies(bench, b'{"vx": 0.3}', 32)
        assert bench.arbiter.current(bench.clock.now_ns()).twist.is_zero
        cleared, why = bench.operator.release_estop()
        assert not cleared
        assert "cmd_vel commands motion" in why
        await asyncio.sleep(1.0)
        assert bench.operator.release_estop()[0]
