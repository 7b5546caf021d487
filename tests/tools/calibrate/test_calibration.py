"""The function that command and page call, on a robot in virtual time."""

from __future__ import annotations

from pathlib import Path

import pytest
from bench_client import BenchClient, TapeAndMarks
from made_calibrations import calibration
from robot_bench import RobotBench

from yahboomd.core.config import Config, Loaded, read
from yahboomd.core.errors import ConfigError, Refused, YahboomdError
from yahboomd.core.model import Pose2d
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.calibrate.calibration import calibrate, ended, undo
from yahboomd.tools.calibrate.calibration_writing import write_calibration
from yahboomd.tools.calibrate.choices import HandTurns, TapeRuns

QUICK = TapeRuns(straight_m=1.0, turns=1, speed_m_s=0.4, turn_speed_rad_s=2.0)
NOWHERE = Pose2d(x=0.0, y=0.0, theta=0.0)


def loaded(config: Config, path: Path | None) -> Loaded:
    return Loaded(config, None, calibration_path=path)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("overrides", "path", "words"),
    [
        (["chassis.wheel_radius_m=0.05"], "calibration.toml", "another robot's configuration"),
        ([], "file/calibration.toml", "cannot be written"),
    ],
)
@on_virtual_time
async def test_a_robot_or_a_file_that_does_not_fit_is_refused_before_a_question(
    tmp_path: Path, overrides: list[str], path: str, words: str
) -> None:
    (tmp_path / "file").write_text("no folder")
    config = read(None, environ={}, overrides=overrides).config
    person = TapeAndMarks(lambda: NOWHERE, 1)
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        async with BenchClient(bench) as client:
            with pytest.raises(ConfigError, match=words):
                await calibrate(
                    client,  # type: ignore[arg-type]
                    loaded(config, tmp_path / path),
                    QUICK,
                    person,
                    clock=bench.clock,
                )
    assert person.asked == []


@on_virtual_time
async def test_who_ends_a_calibration_is_told_whether_the_wheels_stand(tmp_path: Path) -> None:
    async with RobotBench(tmp_path) as bench:
        await bench.ready()
        async with BenchClient(bench) as client:
            client.drive(0.3, for_s=10.0)
            await bench.until(lambda: not bench.standing)
            words = await ended(client, QUICK)  # type: ignore[arg-type]
            assert words == "Ended: the wheels were stopped and stand; nothing was written."
            assert bench.standing
            by_hand = await ended(client, HandTurns())  # type: ignore[arg-type]
            assert by_hand == "Ended: nothing was driven, and nothing was written."


def test_the_newest_calibration_is_taken_back_once(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    write_calibration(path, calibration())
    assert undo(loaded(Config(), path)).startswith(f"Taken back in {path}.")
    for where in (path, None):
        with pytest.raises(Refused, match="no calibration to take back"):
            undo(loaded(Config(), where))
    path.write_text("[another]")
    with pytest.raises(YahboomdError, match=str(path)):
        undo(loaded(Config(), path))
    assert path.exists()
