"""The calibration file: written whole, and taken back."""

from __future__ import annotations

from pathlib import Path

import pytest
from made_calibrations import calibration, loaded

from yahboomd.core.config.calibration_file import read_calibration
from yahboomd.core.errors import ConfigError
from yahboomd.tools.calibrate.calibration_writing import (
    check_writable,
    undo_calibration,
    write_calibration,
)


def test_undo_brings_back_the_one_before_and_then_none(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    write_calibration(path, calibration(1.05))
    write_calibration(path, calibration(1.07))
    assert loaded(tmp_path).config.chassis.wheel_separation_multiplier == 1.07
    assert undo_calibration(path)
    assert loaded(tmp_path).config.chassis.wheel_separation_multiplier == 1.05
    assert undo_calibration(path)
    assert loaded(tmp_path).config.chassis.wheel_separation_multiplier == 1.0
    assert not undo_calibration(path)


@pytest.mark.parametrize("before", [True, False])
def test_undo_removes_no_file_that_is_no_calibration(tmp_path: Path, *, before: bool) -> None:
    path = tmp_path / "config.toml"
    for text in ("x = " + "[" * 5000, "[serial]\n"):
        path.write_text(text)
        with pytest.raises(ConfigError, match="is no calibration"):
            read_calibration(path)
    if before:
        write_calibration(tmp_path / "calibration.toml", calibration(1.05))
        write_calibration(tmp_path / "calibration.toml", calibration(1.07))
    with pytest.raises(ConfigError, match=r"is no calibration.* `rm .*config.toml`"):
        undo_calibration(path)
    assert path.read_text() == "[serial]\n"


def test_a_folder_that_cannot_be_written_is_named_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot be written") as refused:
        write_calibration(tmp_path / "file" / "calibration.toml", calibration())
    assert "chassis.calibration_file=" in str(refused.value)
    with pytest.raises(ConfigError, match="cannot be written"):
        check_writable(tmp_path / "file" / "calibration.toml")
    check_writable(tmp_path / "not" / "there" / "yet" / "calibration.toml")
