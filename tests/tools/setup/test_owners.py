"""Robots with figures as owners have them are set up, calibrated and tuned."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from bench_client import calibrated
from board_bench import LinkBench
from robot_bench import RobotBench
from simulated_person import SimulatedPerson, connected, set_up, true_wiring
from tuning_bench import TuningBench

from yahboomd.core.config import read
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.choices import TapeRuns
from yahboomd.tools.robot.simulated_robot import as_configured
from yahboomd.tools.setup.description import Given
from yahboomd.tools.setup.robot_file import as_toml, write_robot
from yahboomd.tools.tune.tuning_result import no_worse


class Owner(msgspec.Struct, frozen=True):
    """A robot's figures; counts of one turn are lines x ratio x 4."""

    preset: str
    lines: int
    ratio: float
    wheel_diameter_mm: float
    wheel_separation_mm: float
    max_speed_m_s: float


NIGHTLY = pytest.mark.nightly

OWNERS = {
    "belt, 147,456 counts": Owner("2wd", 64, 576.0, 230.0, 610.0, 0.9),
    "585 counts": Owner("2wd", 11, 13.295, 66.0, 137.0, 1.0),
    "2,000 lines": Owner("4wd", 2000, 23.0, 65.0, 165.0, 1.1),
    "linorobot2, 144,000 counts": Owner("2wd", 500, 72.0, 152.0, 271.0, 1.1),
    "3,436 counts": Owner("2wd", 11, 78.09, 66.0, 297.0, 0.5),
    "4,096 counts": Owner("2wd", 1024, 1.0, 66.0, 160.0, 0.24),
    "878.4 counts": Owner("4wd", 12, 18.3, 125.0, 358.0, 0.5),
    "508.8 counts": Owner("2wd", 8, 15.9, 72.0, 235.0, 0.55),
}


async def set_up_as_given(owner: Owner, path: Path) -> LinkBench:
    """The robot, a little larger than its figures, and its written configuration."""
    board = {
        "lines": owner.lines,
        "ratio": owner.ratio,
        "wheel_diameter_mm": owner.wheel_diameter_mm,
    }
    built = read(
        None,
        environ={},
        overrides=[
            "board.profile=custom",
            "board.motor_type=1",
            *(f"board.{key}={value}" for key, value in board.items()),
            f"chassis.preset={owner.preset}",
            f"chassis.wheel_separation_m={owner.wheel_separation_mm / 1000.0}",
        ],
    ).config
    robot = as_configured(built)
    link = LinkBench()
    link.robot = SimulatedRobot(
        msgspec.structs.replace(
            robot,
            wheel_radius_m=1.01 * robot.wheel_radius_m,
            wheel_separation_m=1.03 * robot.wheel_separation_m,
            max_speed_m_s=owner.max_speed_m_s,
        )
    )
    person = SimulatedPerson(link)
    person.others |= {"Encoder lines": str(owner.lines), "Turns of the motor": str(owner.ratio)}
    given = Given(
        profile="custom",
        kinematics=built.kinematics().name,
        wheel_diameter_mm=owner.wheel_diameter_mm,
        wheel_separation_mm=owner.wheel_separation_mm,
    )
    # Without a gear no pulse is short enough: setup refuses, and names the way by hand.
    found = await set_up(link, given, person=person, by_hand=owner.ratio == 1.0)
    assert found.wiring.faults == ()
    assert connected(found) == true_wiring(link)
    write_robot(path, as_toml(found.description, found.wiring), overwrite=True)
    assert read(path, environ={}).config.ticks_per_revolution() == pytest.approx(
        built.ticks_per_revolution()
    )
    return link


# The belt's pulses end after a hundredth of a turn.
@pytest.mark.parametrize(
    "name",
    [
        name if name.startswith(("belt", "585")) else pytest.param(name, marks=NIGHTLY)
        for name in OWNERS
    ],
)
@on_virtual_time
async def test_a_robot_of_an_owner_is_set_up(name: str, tmp_path: Path) -> None:
    await set_up_as_given(OWNERS[name], tmp_path / "robot.toml")


@NIGHTLY
@pytest.mark.parametrize("name", OWNERS)
@on_virtual_time
async def test_a_robot_of_an_owner_is_calibrated_and_tuned(name: str, tmp_path: Path) -> None:
    owner, path = OWNERS[name], tmp_path / "robot.toml"
    link = await set_up_as_given(owner, path)
    speed_m_s = min(0.3, 0.5 * owner.max_speed_m_s)
    turn_rad_s = min(2.0, speed_m_s / (owner.wheel_separation_mm / 2000.0))
    runs = TapeRuns(straight_m=2.0, speed_m_s=speed_m_s, turns=1, turn_speed_rad_s=turn_rad_s)
    async with RobotBench(tmp_path, file=path, robot=link.robot) as bench:
        await bench.ready()
        chassis = (await calibrated(bench, runs, tmp_path)).facts["chassis"]
        assert [event.message for event in bench.heard.events if event.severity == "error"] == []
    radii = [*chassis["wheel_radius_multiplier"].values()]
    assert radii == pytest.approx([1.01] * len(radii), abs=0.003)
    assert chassis["wheel_separation_multiplier"] == pytest.approx(1.03, abs=0.01)

    tuning = TuningBench()
    tuning.link, tuning.config = link, read(path, environ={}).config
    before = await tuning.true_step()
    result = await tuning.tune()
    after = await tuning.true_step()
    print(f"| {name} | {radii[0]:.4f} | {before} | {after} | {result.writes} |")
    assert no_worse([after], [before])
