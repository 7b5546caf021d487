"""Whole calibrations on the vendors' firmwares: the base is not as large as it is configured.

Who measures makes no error, so that what is off is the firmware's and the tool's.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from bench_client import calibrated
from robot_bench import RobotBench
from rosmaster_firmware import firmware_instead_of_simulated, like_the_firmwares
from vendor_firmware import KINDS, LONG, instead_of_simulated, kinds, missing, rosmaster_missing

from yahboomd.simulation.options import TWO_WHEELS, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.choices import SquareRuns, TapeRuns

SCALE, RATIO, TRACK = 1.03, 1.01, 1.04
"""The true size of wheels, right over left wheel, and track, each for one as configured."""

TAPE = TapeRuns(straight_m=1.0, speed_m_s=0.3, turn_speed_rad_s=2.0, turns=1)
SQUARES = SquareRuns(side_m=0.5, count=1, straight_m=1.0, speed_m_s=0.3, turn_speed_rad_s=2.0)
RUNS = {"tape": TAPE, "squares": SQUARES} if LONG else {"tape": TAPE}
TRIED = kinds(4, 2)


@pytest.fixture
def vendors() -> Iterator[None]:
    with instead_of_simulated():
        yield


@pytest.mark.skipif(bool(missing()), reason=missing())
@pytest.mark.usefixtures("vendors")
@pytest.mark.parametrize("motor", TRIED)
@pytest.mark.parametrize("method", RUNS)
@on_virtual_time
async def test_a_whole_calibration_finds_the_true_size(
    tmp_path: Path, method: str, motor: str
) -> None:
    left, right = TWO_WHEELS
    robot = SimulationOptions(
        wheel_radius_m=0.0335 * SCALE,
        wheel_separation_m=0.150 * TRACK,
        wiring=(
            msgspec.structs.replace(left, radius_scale=2.0 / (1.0 + RATIO)),
            msgspec.structs.replace(right, radius_scale=2.0 * RATIO / (1.0 + RATIO)),
        ),
        **KINDS[motor],
    )
    async with RobotBench(tmp_path, (), robot) as bench:
        await bench.ready()
        person = await calibrated(bench, RUNS[method], tmp_path)
    assert "error" not in {event.severity for event in bench.heard.events}
    # No run was asked for again.
    assert person.asked.count("move") == 3
    found = person.facts["chassis"]
    radii = found["wheel_radius_multiplier"]
    off = {
        "scale": (radii["left"] + radii["right"]) / 2.0 / SCALE - 1.0,
        "ratio": radii["right"] / radii["left"] / RATIO - 1.0,
        "track": found["wheel_separation_multiplier"] / TRACK - 1.0,
    }
    print(method, motor, *(f"{name} {part:+.3%}" for name, part in off.items()))
    assert max(map(abs, off.values())) < 0.001
    assert (tmp_path / "calibration.toml").exists()


@pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing())
@on_virtual_time
async def test_a_mecanum_car_finds_its_size_and_its_way_to_the_side_on_the_rosmaster_firmware(
    tmp_path: Path,
) -> None:
    sideways = 0.87
    nominal = like_the_firmwares(1, volts=11.4, start_up_s=0.5)
    robot = msgspec.structs.replace(
        nominal,
        wheel_radius_m=nominal.wheel_radius_m * SCALE,
        wheel_separation_m=nominal.wheel_separation_m * TRACK,
        sideways=sideways,
    )
    overrides = [
        *("board.profile=x3", "chassis.preset=mecanum"),
        f"chassis.wheel_separation_m={nominal.wheel_separation_m}",
        f"chassis.wheel_base_m={nominal.wheel_base_m}",
    ]
    with firmware_instead_of_simulated():
        async with RobotBench(tmp_path, overrides, robot) as bench:
            await bench.ready()
            person = await calibrated(bench, TAPE, tmp_path)
    assert "error" not in {event.severity for event in bench.heard.events}
    assert person.asked.count("move") == 5
    found = person.facts["chassis"]
    off = {
        "scale": found["wheel_radius_multiplier"]["front_left"] / SCALE - 1.0,
        "track": found["wheel_separation_multiplier"] / TRACK - 1.0,
        "sideways": found["sideways_multiplier"] / sideways - 1.0,
    }
    print(*(f"{name} {part:+.3%}" for name, part in off.items()))
    assert max(map(abs, off.values())) < 0.002
