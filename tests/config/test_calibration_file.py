"""The calibration file: a layer over the configuration, for the robot that it was made for."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from made_calibrations import calibration, loaded

from yahboomd.core.config import read
from yahboomd.core.config.calibration_file import Multipliers
from yahboomd.core.config.models import Config, calibration_path
from yahboomd.tools.calibrate.calibration_writing import write_calibration


def test_it_goes_over_the_file_and_under_environment_and_set(tmp_path: Path) -> None:
    write_calibration(tmp_path / "calibration.toml", calibration())
    file = tmp_path / "robot.toml"
    file.write_text("[chassis]\nwheel_separation_multiplier = 1.5\n")
    environ = {"STATE_DIRECTORY": str(tmp_path)}
    found = read(file, environ=environ)
    assert found.config.chassis.wheel_separation_multiplier == 1.05
    assert found.config.chassis.wheel_radius_multiplier == {"left": 1.01, "right": 1.02}
    origin = found.origins["chassis", "wheel_separation_multiplier"]
    assert origin.words == f"{tmp_path / 'calibration.toml'} (tape, 2026-05-04 10:00 UTC)"
    over = read(file, environ=environ, overrides=["chassis.wheel_separation_multiplier=1.2"])
    assert over.config.chassis.wheel_separation_multiplier == 1.2
    assert over.config.chassis.wheel_radius_multiplier == {"left": 1.01, "right": 1.02}
    by_environ = environ | {"YAHBOOMD_CHASSIS__WHEEL_SEPARATION_MULTIPLIER": "1.3"}
    assert read(file, environ=by_environ).config.chassis.wheel_separation_multiplier == 1.3


@pytest.mark.parametrize(
    "override",
    ["chassis.wheel_separation_m=0.16", "chassis.wheel_radius_m=0.03", "board.profile=310"],
)
def test_it_is_ignored_with_a_warning_where_the_robot_changed(tmp_path, override) -> None:
    write_calibration(tmp_path / "calibration.toml", calibration())
    found = loaded(tmp_path, override)
    assert found.config.chassis.wheel_separation_multiplier == 1.0
    (warning,) = found.warnings
    assert "is ignored: it was made for another robot" in warning
    assert "chassis.w" in warning


@pytest.mark.parametrize("text", ["[broken", "made = 1", "", "\udcff"])
def test_a_damaged_file_is_ignored_with_a_warning(tmp_path: Path, text: str) -> None:
    (tmp_path / "calibration.toml").write_bytes(text.encode(errors="surrogateescape"))
    found = loaded(tmp_path)
    assert found.config == read(None, environ={}, standard_path=tmp_path / "none").config
    (warning,) = found.warnings
    assert warning.startswith(f"{tmp_path / 'calibration.toml'} is no calibration:")


@pytest.mark.parametrize(
    ("environ", "path", "user_id", "expected"),
    [
        ({"STATE_DIRECTORY": "/s:/t"}, None, 5, "/s/calibration.toml"),
        ({}, "/etc/yahboomd/config.toml", 5, "/var/lib/yahboomd/calibration.toml"),
        ({}, "/etc/yahboomd/left.toml", 5, "/var/lib/yahboomd-left/calibration.toml"),
        ({}, None, 0, "/var/lib/yahboomd/calibration.toml"),
        ({"XDG_STATE_HOME": "/x"}, None, 5, "/x/yahboomd/calibration.toml"),
        ({"HOME": "/h"}, None, 5, "/h/.local/state/yahboomd/calibration.toml"),
        ({}, None, 5, None),
    ],
)
def test_it_is_in_the_state_directory_of_whom_the_configuration_is(
    environ, path, user_id, expected
) -> None:
    found = calibration_path(Config(), environ, path and Path(path), user_id=user_id)
    assert found == (expected and Path(expected))


def test_a_mecanum_base_has_three_multipliers_and_others_two(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    write_calibration(path, calibration())
    assert "sideways" not in path.read_text()
    base = ("chassis.preset=mecanum", "chassis.wheel_base_m=0.2")
    config = read(None, environ={}, overrides=base).config
    made = calibration(config=config)
    corners = config.kinematics().wheels
    both = {
        name: Multipliers(
            wheel_radius_multiplier=dict.fromkeys(corners, 1.0),
            wheel_separation_multiplier=1.0,
            sideways_multiplier=factor,
        )
        for name, factor in (("chassis", 0.87), ("before", 1.0))
    }
    write_calibration(path, made.model_copy(update=both))
    found = loaded(tmp_path, *base)
    assert found.config.chassis.sideways_multiplier == 0.87
    assert "calibration.toml" in found.origins["chassis", "sideways_multiplier"].words
    (warning,) = loaded(tmp_path, base[0], "chassis.wheel_base_m=0.21").warnings
    assert "chassis.wheel_base_m was 0.2 and is 0.21" in warning
    forward = found.config.kinematics().forward
    assert forward[1][1] == pytest.approx(0.25 * 0.87)


@pytest.mark.parametrize("kind", ["pipe", "folder", "device"])
def test_what_is_no_file_is_ignored_with_a_warning_and_does_not_hang_the_start(
    tmp_path: Path, kind: str
) -> None:
    path = tmp_path / "calibration.toml"
    {
        "pipe": os.mkfifo,
        "folder": Path.mkdir,
        "device": lambda at: at.symlink_to("/dev/zero"),
    }[kind](path)
    found = loaded(tmp_path)
    (warning,) = found.warnings
    assert f"{path} cannot be read" in warning
    assert "drives uncalibrated" in warning
    assert found.config.chassis.wheel_separation_multiplier == 1.0
