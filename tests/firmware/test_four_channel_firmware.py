"""The daemon's control path on the vendor's firmware 1.7.3, on virtual time."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from board_bench import LinkBench
from fault_bench import FaultBench
from vendor_firmware import KINDS, ON_THE_FIRMWARE, kinds

from yahboomd.core.link.stopping import stop_unidentified
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time

pytestmark = ON_THE_FIRMWARE


@pytest.mark.parametrize("motor", kinds(2, 1))
@on_virtual_time
async def test_each_motor_drives_a_curve_whose_pose_is_true_and_stands_at_an_estop(
    tmp_path: Path, motor: str
) -> None:
    async with FaultBench(tmp_path, simulation=SimulationOptions(**KINDS[motor])) as bench:
        await bench.ready()
        await bench.drive(3.0, 0.3, 0.5)
        assert min(bench.rim_speeds) > 0.15
        bench.operator.engage_estop("a test")
        at_ns = bench.clock.now_ns()
        await asyncio.sleep(2.0)
        assert bench.stood_at(at_ns) - at_ns < 1_500_000_000
        truth = bench.robot.truth(bench.clock.now_ns())
        pose = bench.heard.estimates[-1].pose
        assert pose.x == pytest.approx(truth.x, abs=0.005)
        assert pose.y == pytest.approx(truth.y, abs=0.005)
        assert pose.theta == pytest.approx(truth.theta, abs=0.02)
        assert not {"runaway_against", "runaway_fast", "board_reset"} & {*bench.heard.kinds}
    # At the end the motors have no power.
    assert [each.pwm for each in bench.robot.plant.motors] == [0, 0]


@on_virtual_time
async def test_after_a_reset_in_motion_the_pose_goes_on_without_a_jump(tmp_path: Path) -> None:
    async with FaultBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        before = bench.heard.estimates[-1].pose.x
        bench.do("reset")
        await bench.drive(0.5, 0.3)
        assert "board_reset" in bench.heard.kinds
        assert 0.0 <= bench.heard.estimates[-1].pose.x - before < 0.25
        await bench.drive(2.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.05)


@pytest.mark.parametrize("command", [b"$spd:300,0,300,0#", b"$pwm:1500,0,1500,0#"])
@pytest.mark.parametrize("half", [b"", b"$", b"$spd:300,300,3"])
@on_virtual_time
async def test_the_first_words_on_a_port_stop_wheels_that_turn(command: bytes, half: bytes) -> None:
    board = LinkBench()
    port = await board.open()
    port.write(command)
    await asyncio.sleep(1.0)
    assert max(board.rim_speeds) > 0.25
    port.write(half)
    await asyncio.sleep(0.02)
    assert await stop_unidentified(port, LoopClock())
    await asyncio.sleep(1.0)
    assert max(map(abs, board.rim_speeds)) < 0.03
    assert [each.pwm for each in board.robot.plant.motors] == [0, 0]
    port.close()
