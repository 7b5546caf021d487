"""A geometry that lives in these tests alone: a builder and a row, registered while they run.

Three omnidirectional wheels, 120 degrees apart. No simulated robot moves as it does: the truth is
that of its wheels, and the body's is computed from them here, by the geometry's textbook formula.
"""

from __future__ import annotations

import asyncio
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path

import pytest
from fault_bench import FaultBench
from simulated_person import outcome

from yahboomd.cli.main import main
from yahboomd.core.config import Config
from yahboomd.core.drive.kinematics import KINEMATICS
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import VelocityCommand
from yahboomd.core.model import Kinematics, Twist2d
from yahboomd.moves.motion.base_limits import base_of
from yahboomd.simulation.options import SimulationOptions, Wiring
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.setup.robot_drawing import picture
from yahboomd.tools.setup.robot_file import as_toml
from yahboomd.web.robot_feed import limits_of

RADIUS_M = 0.12
PLACES = {"front_left": 60.0, "rear": 180.0, "front_right": 300.0}
"""Where each wheel is, seen from the middle, in degrees to the left of ahead."""


def omni3(*, separation_m: float, **_: float | None) -> Kinematics:
    """Each rim goes along the circle on which the wheels stand: ``-sin a vx + cos a vy + r wz``."""
    radius_m = separation_m / 2.0
    angles = [math.radians(degrees) for degrees in PLACES.values()]
    return Kinematics(
        name="omni3",
        wheels=tuple(PLACES),
        inverse=tuple((-math.sin(a), math.cos(a), radius_m) for a in angles),
        forward=(
            tuple(-2.0 / 3.0 * math.sin(a) for a in angles),
            tuple(2.0 / 3.0 * math.cos(a) for a in angles),
            (1.0 / (3.0 * radius_m),) * 3,
        ),
        holonomic=True,
    )


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(KINEMATICS, dict)
    monkeypatch.setitem(KINEMATICS, "omni3", omni3)


CHASSIS = [
    "chassis.kinematics=omni3",
    f"chassis.wheel_separation_m={2.0 * RADIUS_M}",
    "chassis.motors={front_left=[{position=1}], rear=[{position=2}], front_right=[{position=3}]}",
]
THREE = SimulationOptions(
    wiring=tuple(
        Wiring(name=name, position=position, corner=corner)
        for position, (name, corner) in enumerate(
            zip(PLACES, ("left", "left", "right"), strict=True), start=1
        )
    )
)


def body(speeds: Mapping[str, float]) -> Twist2d:
    """How three such wheels move their base."""
    a = {name: math.radians(degrees) for name, degrees in PLACES.items()}
    return Twist2d(
        vx=2.0 / 3.0 * sum(-math.sin(a[name]) * speed for name, speed in speeds.items()),
        vy=2.0 / 3.0 * sum(math.cos(a[name]) * speed for name, speed in speeds.items()),
        wz=sum(speeds.values()) / (3.0 * RADIUS_M),
    )


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    "wish", [Twist2d(vx=0.2), Twist2d(vy=-0.2), Twist2d(wz=1.0), Twist2d(vx=0.15, vy=0.1, wz=-0.5)]
)
@on_virtual_time
async def test_it_drives_and_knows_how(tmp_path: Path, wish: Twist2d) -> None:
    payload = encode(VelocityCommand(vx=wish.vx, vy=wish.vy, wz=wish.wz), "json")
    async with FaultBench(tmp_path, CHASSIS, THREE) as bench:
        await bench.ready()
        for _ in range(50):
            bench.payload(payload)
            await asyncio.sleep(0.05)
        bench.robot.advance(bench.clock.now_ns())
        true = body(dict(zip(PLACES, bench.truth[-1].speed_m_s, strict=False)))
        counted = bench.heard.estimates[-1].twist
        for seen in (true, counted):
            assert (seen.vx, seen.vy) == pytest.approx((wish.vx, wish.vy), abs=0.01)
            assert seen.wz == pytest.approx(wish.wz, abs=0.05)
        await asyncio.sleep(1.5)
        assert bench.standing
        assert bench.heard.kinds == ["connected"]


def test_config_check_takes_it_and_names_what_is_wrong_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "robot.toml"
    file.write_text(toml())
    assert main(["config", "check", "--config", str(file)]) == 0
    file.write_text(toml().replace("rear", "back"))
    assert main(["config", "check", "--config", str(file)]) == 78
    assert "rear" in capsys.readouterr().err


def toml() -> str:
    """What `setup` writes of such a robot."""
    found = outcome("omni3")
    return as_toml(found.description, found.wiring)


def test_setup_writes_it_and_lists_its_wheels_for_the_person() -> None:
    config = Config.model_validate(tomllib.loads(toml()))
    assert config.kinematics() == omni3(separation_m=0.17)
    assert [name for name in PLACES if name in picture(omni3(separation_m=0.17))] == [*PLACES]


def test_page_and_moves_drive_it_sideways() -> None:
    config = Config.model_validate(tomllib.loads(toml())).resolved().as_data()
    assert limits_of(config)["vy"] == limits_of(config)["vx"]
    assert base_of(config).holonomic
