"""The e-stop and its release, as people ask for them."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest
from robot_bench import RobotBench

from yahboomd.daemon.latch_file import LatchFile
from yahboomd.model import Pose2d
from yahboomd.simulation.motors import MotorFaults
from yahboomd.simulation.virtual_time import on_virtual_time


@on_virtual_time
async def test_engaging_says_what_was_done_and_once_more_that_it_was_done_already(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        assert bench.operator.engage_estop("a test") == "Emergency stop engaged by a test."
        assert "already" in bench.operator.engage_estop("another")
        assert bench.heard.kinds.count("estop") == 1


@on_virtual_time
async def test_the_next_frame_on_the_wire_is_the_stop_within_the_spacing(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        await asyncio.sleep(0.03)
        assert bench.port is not None
        written = len(bench.port.written)
        engaged_ns = bench.clock.now_ns()
        bench.operator.engage_estop("a test")
        await bench.until(lambda: bench.port is not None and len(bench.port.written) > written)
        assert bench.port.frames[written] == b"$spd:0,0,0,0#"
        assert bench.port.written[written][0] - engaged_ns < 13_000_000


@on_virtual_time
async def test_engaging_again_says_the_stop_again(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        bench.operator.engage_estop("a test")
        await asyncio.sleep(1.0)
        said = bench.controller.counters["stops_said"]
        bench.operator.engage_estop("a test")
        assert bench.controller.counters["stops_said"] == said + 1


@on_virtual_time
async def test_a_release_where_nothing_is_engaged_does_no_harm(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        assert bench.operator.release_estop() == (
            True,
            "Nothing to release: no e-stop, no fault.",
        )
        assert "estop_released" not in bench.heard.kinds


@on_virtual_time
async def test_a_refused_release_is_counted_and_told(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        words = bench.operator.refuse_release("A sample")
        assert "yahboomd/estop/reset" in words
        assert bench.controller.counters["release_refused"] == 1
        assert "estop_release_refused" in bench.heard.kinds
        bench.operator.refuse_release("A sample", times=1_000)
        assert bench.controller.counters["release_refused"] == 1_001
        assert bench.heard.kinds.count("estop_release_refused") == 2


@on_virtual_time
async def test_a_fault_is_cleared_only_while_nobody_commands_motion(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        faults = MotorFaults(encoder_dead=True)
        bench.robot.set_faults("left", faults, now_ns=bench.clock.now_ns())
        await bench.drive(2.0, 0.3)
        cleared, words = bench.operator.release_estop()
        assert not cleared
        assert "cmd_vel commands motion" in words
        await asyncio.sleep(1.0)
        cleared, words = bench.operator.release_estop()
        assert cleared
        # What happened, and not again what to do about it.
        assert words.startswith("Cleared the fault: left")
        assert words.count(". ") == 0
        assert bench.operator.release_estop() == (True, "Nothing to release: no e-stop, no fault.")


@on_virtual_time
async def test_one_release_opens_the_latch_and_clears_the_fault(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        faults = MotorFaults(encoder_dead=True)
        bench.robot.set_faults("left", faults, now_ns=bench.clock.now_ns())
        await bench.drive(2.0, 0.3)
        bench.operator.engage_estop("a test")
        await asyncio.sleep(1.0)
        released, words = bench.operator.release_estop()
        assert released
        assert "Cleared the fault" in words
        assert bench.controller.state()[0] == "standing"


@on_virtual_time
async def test_setting_the_pose_says_where_the_robot_is_now(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        words = bench.operator.set_pose(Pose2d(x=1.0, y=-2.0, theta=0.5), None)
        assert words == "The pose is x 1 m, y -2 m, theta 0.5 rad."
        assert "pose_set" in bench.heard.kinds


@pytest.mark.parametrize("hangs", [False, True])
async def test_an_acknowledgement_says_when_the_stop_would_not_survive_a_restart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, hangs: bool
) -> None:
    let_go = threading.Event()
    if hangs:
        monkeypatch.setattr(LatchFile, "engage", lambda *_: let_go.wait(60.0))
    bench = RobotBench(tmp_path)
    words = bench.operator.engage_estop("a test")
    # The wheels do not wait for the disk.
    assert bench.controller.state()[0] == "estopped"
    told = await bench.operator.remembered(words)
    assert told.startswith("Emergency stop engaged by a test.")
    assert ("would not survive a restart" in told) is hangs
    assert ("not on file" in bench.controller.state()[1]) is hangs
    assert bench.controller.facts()["estop_not_on_file"] == int(hangs)
    let_go.set()
    assert bench.latch.settle()
    bench.controller.close()
