"""Runs count from the moment at which a person let them begin, and are measured at their ends."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from bench_client import BenchClient, TapeAndMarks, calibrated
from robot_bench import RobotBench

from yahboomd.core.config import read
from yahboomd.core.errors import Refused
from yahboomd.core.model import Pose2d
from yahboomd.simulation.options import PLAIN_GAIN, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.choices import SquareRuns, TapeRuns
from yahboomd.tools.calibrate.shapes import LegDriver
from yahboomd.tools.calibrate.wizard import MeasuredRuns
from yahboomd.tools.terminal.asking import LargestMove, Number

SIZE = {"wheel_radius_m": 0.0345, "wheel_separation_m": 0.162}
"""Configured are 0.0335 and 0.150."""


class _Pushing(TapeAndMarks):
    """A person who pushes the robot onto its mark before they let it begin."""

    def __init__(self, bench: RobotBench) -> None:
        super().__init__(lambda: truth(bench), 1)
        self._bench = bench

    async def start(self, name: str, words: str, bounds: LargestMove) -> None:
        await self._bench.drive(1.0, 0.4)
        await self._bench.until(lambda: self._bench.standing)
        await super().start(name, words, bounds)


def truth(bench: RobotBench) -> Pose2d:
    bench.robot.truth(bench.clock.now_ns())
    return bench.robot.plant.chassis.pose


@on_virtual_time
async def test_the_way_onto_its_mark_is_no_part_of_a_run(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        choices = TapeRuns(straight_m=0.5, speed_m_s=0.4, turns=1, turn_speed_rad_s=2.0)
        async with BenchClient(bench) as client:
            driver = LegDriver(client, bench.config, "cmd_vel", clock=bench.clock)  # type: ignore[arg-type]
            measured = MeasuredRuns(driver, _Pushing(bench), choices)
            straight = await measured._straight(bend=False, heading=False)
        counted = float((straight.left + straight.right).sum()) / 2.0
        assert counted == pytest.approx(0.5, abs=0.1)
        assert straight.measured[0] == pytest.approx(counted, abs=0.01)
        # It came this far with the push.
        assert truth(bench).x > 0.7


class _Resetting(TapeAndMarks):
    """The board resets itself in the first run."""

    def __init__(self, bench: RobotBench) -> None:
        super().__init__(lambda: truth(bench), 1)
        self._bench = bench
        self.announced: list[str] = []

    async def start(self, name: str, words: str, bounds: LargestMove) -> None:
        await super().start(name, words, bounds)
        self.announced.append(words)
        if len(self.announced) == 1:
            reset = partial(self._bench.robot.reset, self._bench.clock.now_ns() + 800_000_000)
            asyncio.get_running_loop().call_later(0.8, reset)


@on_virtual_time
async def test_a_run_in_which_the_board_reset_itself_does_not_count(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        choices = TapeRuns(straight_m=0.5, speed_m_s=0.4, turns=1, turn_speed_rad_s=2.0)
        person = _Resetting(bench)
        async with BenchClient(bench) as client:
            driver = LegDriver(client, bench.config, "cmd_vel", clock=bench.clock)  # type: ignore[arg-type]
            await MeasuredRuns(driver, person, choices)._straight(bend=False, heading=False)
    assert "This run does not count" in person.announced[1]
    assert person.asked == ["move", "move", "length"]


@pytest.mark.nightly
@on_virtual_time
async def test_squares_and_a_straight_are_measured_at_their_ends(tmp_path: Path) -> None:
    choices = SquareRuns(count=1, side_m=0.4, speed_m_s=0.4, turn_speed_rad_s=2.0, straight_m=1.0)
    async with RobotBench(tmp_path, (), SimulationOptions(**SIZE)) as bench:
        await bench.ready()
        person = await calibrated(bench, choices, tmp_path)
    square = ["move", "ahead", "left", "heading"]
    assert person.asked == [*square, *square, "move", "length", "left", "heading"]
    assert person.runs == ["square left", "square right", "straight"]
    found: dict[str, Any] = person.facts["chassis"]
    assert found["wheel_radius_multiplier"] == pytest.approx(
        dict.fromkeys(("left", "right"), 0.0345 / 0.0335), rel=2e-3
    )
    assert found["wheel_separation_multiplier"] == pytest.approx(0.162 / 0.150, rel=5e-3)


@on_virtual_time
async def test_a_mecanum_base_goes_to_both_sides_and_gets_three_multipliers(tmp_path: Path) -> None:
    base = ("chassis.preset=mecanum", "chassis.wheel_base_m=0.15")
    robot = SimulationOptions(
        drive="mecanum",
        wheel_radius_m=0.0345,
        wheel_separation_m=0.165,
        wheel_base_m=0.15,
        sideways=0.87,
    )
    choices = TapeRuns(straight_m=1.0, sideways_m=0.6, turns=1, speed_m_s=0.4, turn_speed_rad_s=2.0)
    async with RobotBench(tmp_path, base, robot) as bench:
        await bench.ready()
        person = await calibrated(bench, choices, tmp_path)
    asked = [name for name in person.asked if name != "move"]
    assert asked == ["side", "length", "length", "length", "side", "beyond", "beyond"]
    assert person.runs[:2] == ["sideways left", "sideways right"]
    assert person.facts["refused"] == []
    found: dict[str, Any] = person.facts["chassis"]
    assert found["wheel_radius_multiplier"]["rear_left"] == pytest.approx(0.0345 / 0.0335, rel=2e-3)
    assert found["wheel_separation_multiplier"] == pytest.approx(1.1, rel=0.01)
    assert found["sideways_multiplier"] == pytest.approx(0.87, rel=5e-3)
    written = (tmp_path / "calibration.toml").read_text()
    assert f"sideways_multiplier = {found['sideways_multiplier']}" in written


@on_virtual_time
async def test_wheels_that_are_mounted_mirrored_are_named(tmp_path: Path) -> None:
    base = ("chassis.preset=mecanum", "chassis.wheel_base_m=0.15")
    robot = SimulationOptions(drive="mecanum", sideways=-0.87)
    async with RobotBench(tmp_path, base, robot) as bench:
        await bench.ready()
        with pytest.raises(Refused, match="Exchange the left and the right wheel of each axle"):
            await calibrated(bench, TapeRuns(sideways_m=0.6, speed_m_s=0.4), tmp_path)


class _SaysRight(TapeAndMarks):
    """A person who saw it turn to the right."""

    async def number(self, question: Number) -> float:
        return 2.0 if question.name == "side" else await super().number(question)


@on_virtual_time
async def test_a_turn_to_the_other_side_is_refused_and_names_the_exchanged_plugs(
    tmp_path: Path,
) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        choices = TapeRuns(straight_m=0.3, speed_m_s=0.4, turns=1, turn_speed_rad_s=2.0)
        async with BenchClient(bench) as client:
            driver = LegDriver(client, bench.config, "cmd_vel", clock=bench.clock)  # type: ignore[arg-type]
            person = _SaysRight(lambda: truth(bench), 1)
            with pytest.raises(Refused, match="left and the right motors are exchanged"):
                await MeasuredRuns(driver, person, choices).by_tape(choices, bend=False)
        assert driver.gyro_rad == 0.0


@pytest.mark.parametrize("stick", [pytest.param(1.0, marks=pytest.mark.nightly), 1.2])
@on_virtual_time
async def test_the_speed_at_which_wheels_begin_to_turn_is_written_and_read(
    tmp_path: Path, stick: float
) -> None:
    robot = SimulationOptions(motor_dead_zone=1600, sticks=(stick,), loop_gain=PLAIN_GAIN)
    choices = TapeRuns(straight_m=1.0, speed_m_s=0.3, turns=1, turn_speed_rad_s=3.0)
    async with RobotBench(tmp_path, (), robot) as bench:
        await bench.ready()
        await calibrated(bench, choices, tmp_path)
    file = f"chassis.calibration_file={tmp_path / 'calibration.toml'}"
    chassis = read(None, environ={}, overrides=[file]).config.chassis
    if stick == 1.0:
        assert 0.0 < chassis.break_away_linear_m_s < 0.05
    else:
        assert 0.05 < chassis.break_away_linear_m_s < 0.15
        assert 0.6 < chassis.break_away_angular_rad_s < 2.0
