"""An X3 whose wheels count 1040 to a turn, on the vendor's Rosmaster firmware 3.5.1.

Its profile has 1320. A Sunrise counts 1040, and the board that is told so latches the alarm of its
battery, and reads its encoders backward.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from bench_client import calibrated
from board_bench import LinkBench
from robot_bench import RobotBench
from rosmaster_firmware import firmware_instead_of_simulated, like_the_firmwares
from simulated_person import SimulatedPerson, set_up
from vendor_firmware import rosmaster_missing

from yahboomd.core.config import Config
from yahboomd.core.errors import Refused
from yahboomd.core.link.storing import store
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.choices import TapeRuns
from yahboomd.tools.port import probing
from yahboomd.tools.setup.description import Given
from yahboomd.tools.setup.robot_file import as_toml

pytestmark = [
    pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing()),
    pytest.mark.usefixtures("vendors"),
]

X3 = msgspec.structs.replace(
    like_the_firmwares(1, volts=11.4, start_up_s=0.5), lines=13, ratio=20.0
)
DESCRIBED = Given(
    profile="x3",
    kinematics="mecanum",
    wheel_diameter_mm=65.0,
    wheel_separation_mm=169.0,
    wheel_base_mm=160.0,
)
CONFIGURED = (
    "board.profile=x3",
    "chassis.preset=mecanum",
    "chassis.wheel_separation_m=0.169",
    "chassis.wheel_base_m=0.16",
)


@pytest.fixture
def vendors() -> Iterator[None]:
    with firmware_instead_of_simulated():
        yield


def bench_of(**changed: object) -> LinkBench:
    options = msgspec.structs.replace(X3, **changed)
    return LinkBench(**{name: getattr(options, name) for name in options.__struct_fields__})


def car_type(bench: LinkBench | RobotBench) -> int:
    flash: RosmasterStored = bench.robot.board.flash  # type: ignore[attr-defined]
    return flash.car_type


@on_virtual_time
async def test_setup_writes_its_counts_and_leaves_it_an_x3() -> None:
    bench = bench_of()
    person = SimulatedPerson(bench)
    person.looks = True
    person.others["Write 1040 counts"] = "y"
    found = await set_up(bench, DESCRIBED, person=person)
    config = Config.model_validate(tomllib.loads(as_toml(found.description, found.wiring)))
    assert (config.profile().name, config.ticks_per_revolution()) == ("x3", 1040.0)
    assert car_type(bench) == 1


@on_virtual_time
async def test_tape_names_its_counts_and_with_them_it_drives_as_commanded(tmp_path: Path) -> None:
    runs = TapeRuns(straight_m=1.0, speed_m_s=0.3, turn_speed_rad_s=2.0, turns=1)
    async with RobotBench(tmp_path, CONFIGURED, X3) as bench:
        await bench.ready()
        with pytest.raises(Refused, match=r"chassis\.ticks_per_revolution = 1040, and leave"):
            await calibrated(bench, runs, tmp_path)
        assert car_type(bench) == 1
    ticks = "chassis.ticks_per_revolution=1040"
    async with RobotBench(tmp_path / "again", (*CONFIGURED, ticks), X3) as bench:
        await bench.ready()
        await bench.drive(3.0, 0.3)
        truth = bench.robot.truth(bench.clock.now_ns())
        assert truth.vx == pytest.approx(0.3, abs=0.02)
        assert bench.heard.estimates[-1].pose.x == pytest.approx(truth.x, abs=0.02)


@on_virtual_time
async def test_an_x3_that_was_made_a_sunrise_gets_its_type_back_while_the_alarm_is_on() -> None:
    bench = bench_of(flash=RosmasterStored(car_type=6), start_up_s=10.5)
    await bench.drive(0, for_s=3.0)
    found = await probing.examine(bench.open, bench.clock, {})
    assert found.ticks is None
    assert "that is the battery of another car" in found.silence
    storing = await store(bench.open, bench.clock, PROFILES["x3"].settings)
    assert [(step.outcome, step.attempts) for step in storing.steps] == [("stored", 1)]
    assert car_type(bench) == 1
    found = await probing.examine(bench.open, bench.clock, {})
    assert found.standing is True
