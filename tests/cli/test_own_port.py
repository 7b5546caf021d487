from __future__ import annotations

import os
from pathlib import Path

import pytest

from yahboomd.core.config import Config
from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.errors import ConfigError, PortLost, PortMissing, Refused
from yahboomd.tools.port.own_port import refuse_estop, with_hints


def test_a_port_without_an_emergency_stop_is_free_to_turn_wheels(tmp_path: Path) -> None:
    refuse_estop("/tmp/board", Config(), {"RUNTIME_DIRECTORY": str(tmp_path)})


def test_an_engaged_emergency_stop_is_refused_and_says_how_to_release_it(tmp_path: Path) -> None:
    environ = {"RUNTIME_DIRECTORY": str(tmp_path)}
    config = Config.model_validate({"serial": {"port": "/tmp/board"}})
    LatchFile(config.latch_path(environ, user_id=os.getuid())).engage("a person")
    with pytest.raises(Refused, match=r"is engaged.*yahboomd stop --release"):
        refuse_estop("/tmp/board", Config(), environ)
    refuse_estop("/tmp/another", Config(), environ)


def test_a_latch_file_that_the_configuration_names_is_looked_at(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    folder.mkdir()
    config = Config.model_validate({"estop": {"latch_file": str(folder / "latch")}})
    LatchFile(folder / "latch").engage("a person")
    with pytest.raises(Refused, match="is engaged"):
        refuse_estop("/tmp/board", config, {"RUNTIME_DIRECTORY": str(tmp_path)})


def test_a_folder_that_cannot_be_read_counts_as_engaged(tmp_path: Path) -> None:
    (tmp_path / "yahboomd").write_text("no folder")
    with pytest.raises(Refused, match="cannot be read"):
        refuse_estop("/tmp/board", Config(), {"XDG_RUNTIME_DIR": str(tmp_path)})


def test_hints_are_added_to_errors_of_the_port_alone() -> None:
    missing = with_hints(PortMissing("no /nowhere/board."), "/nowhere/board")
    assert isinstance(missing, PortMissing)
    assert missing.message == "no /nowhere/board."
    error = ConfigError("two ports")
    assert with_hints(error, "") is error


def test_a_board_that_is_gone_may_still_turn_a_wheel_and_the_error_says_how_to_stop_it() -> None:
    error = with_hints(PortLost("/dev/ttyUSB0: the port went away."), "/dev/ttyUSB0")
    assert isinstance(error, PortLost)
    assert "switch the motors' supply off" in error.remedy
    assert "`yahboomd stop`" in error.remedy
