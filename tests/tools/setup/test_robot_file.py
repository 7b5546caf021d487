from __future__ import annotations

from pathlib import Path

import pytest
from simulated_person import outcome

from yahboomd.core.config import Config, read
from yahboomd.core.drive.kinematics import KINEMATICS
from yahboomd.core.errors import ConfigError
from yahboomd.tools.calibrate.estimates.wiring import WiringFault, WiringFound
from yahboomd.tools.setup.outcome import SetupOutcome
from yahboomd.tools.setup.robot_file import as_toml, write_robot

TEXT = as_toml(outcome().description, outcome().wiring)


def config_of(found: SetupOutcome, folder: Path, **more: str) -> Config:
    path = folder / "robot.toml"
    write_robot(path, as_toml(found.description, found.wiring, **more), overwrite=True)
    return read(path, environ={}).config


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_the_file_is_a_configuration_with_what_was_found(kinematics: str, tmp_path: Path) -> None:
    found = outcome(kinematics)
    config = config_of(found, tmp_path, port="/dev/ttyUSB7")
    assert config.kinematics().name == kinematics
    assert (config.serial.port, config.profile().name) == ("/dev/ttyUSB7", "520")
    assert config.chassis.wheel_radius_m == 0.0325
    assert config.chassis.wheel_separation_m == 0.17
    assert {(m.name, m.position, m.command_sign, m.encoder_sign) for m in config.motors()} == {
        (motor.wheel, motor.position, motor.sign, motor.sign) for motor in found.wiring.motors
    }
    assert config.chassis.wheel_base_m == found.description.wheel_base_mm or (
        config.chassis.wheel_base_m == 0.16
    )


def test_other_motors_have_their_figures(tmp_path: Path) -> None:
    board = {"profile": "custom", "lines": 13, "ratio": 20.4, "wheel_diameter_mm": 65.0}
    profile = config_of(outcome(**board), tmp_path).profile()
    assert (profile.lines, profile.ratio) == (13, 20.4)


def test_what_has_to_be_repaired_stands_at_its_head() -> None:
    fault = WiringFault("encoder_dead", 1, "left", "M1 is not counted.")
    found = outcome()
    wiring = WiringFound(motors=found.wiring.motors, faults=(fault,))
    text = as_toml(found.description, wiring)
    assert "# To be repaired: M1 is not counted." in text.splitlines()


def test_a_file_that_is_there_is_kept_and_a_wrong_one_is_never_written(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("# mine\n")
    with pytest.raises(ConfigError, match="there already"):
        write_robot(path, TEXT, overwrite=False)
    with pytest.raises(ConfigError, match="wheel_radius_m"):
        write_robot(path, "[chassis]\nwheel_radius_m = -1.0\n", overwrite=True)
    assert path.read_text() == "# mine\n"
    assert [each.name for each in tmp_path.iterdir()] == ["robot.toml"]
    write_robot(path, TEXT, overwrite=True)
    assert path.stat().st_mode & 0o777 == 0o644
