"""The parts of an installation."""

from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.config import read
from yahboomd.tools.service import install_plan

PROGRAM = Path("/opt/robot/bin/yahboomd")


def fates(root: Path) -> dict[str, str]:
    files = install_plan.planned_files(root, PROGRAM, packaged=False)
    return {file.path.name: file.fate for file in files}


def put(root: Path) -> None:
    for file in install_plan.planned_files(root, PROGRAM, packaged=False):
        file.path.parent.mkdir(parents=True, exist_ok=True)
        file.path.write_text(file.text)


def test_on_an_empty_system_everything_is_new(tmp_path: Path) -> None:
    assert fates(tmp_path) == {
        "yahboomd.service": "new",
        "yahboomd@.service": "new",
        "yahboomd-metrics.service": "new",
        "yahboomd-moves.service": "new",
        "yahboomd-web.service": "new",
        "95-yahboomd.rules": "new",
        "yahboomd.conf": "new",
        "config.toml": "new",
    }


def test_a_persons_configuration_is_kept_and_our_own_files_are_replaced(tmp_path: Path) -> None:
    put(tmp_path)
    (tmp_path / "etc/yahboomd/config.toml").write_text("[serial]\n")
    (tmp_path / "etc/systemd/system/yahboomd.service").write_text("of an older version\n")
    now = fates(tmp_path)
    assert now["config.toml"] == "kept"
    assert now["yahboomd.service"] == "changed"


def test_every_command_of_the_units_is_the_program_that_installs(tmp_path: Path) -> None:
    units = [
        file.text
        for file in install_plan.planned_files(tmp_path, PROGRAM, packaged=False)
        if file.path.suffix == ".service"
    ]
    daemons = [unit for unit in units if f"ExecStart={PROGRAM} run " in unit]
    assert len(daemons) == 2
    assert all(f"exec {PROGRAM} stop " in unit for unit in daemons)
    assert sum(f"ExecStart={PROGRAM} metrics " in unit for unit in units) == 1
    assert sum(f"ExecStart={PROGRAM} web " in unit for unit in units) == 1
    assert not any(install_plan.UNIT_PROGRAM in unit for unit in units)


def test_the_files_of_a_package_are_the_packages_business(tmp_path: Path) -> None:
    assert install_plan.planned_files(tmp_path, PROGRAM, packaged=True) == []


def test_the_configuration_of_an_instance_can_be_used(tmp_path: Path) -> None:
    file = install_plan.instance_file(tmp_path, "front", "/dev/serial/by-path/usb-0:1.2-port0")
    file.path.parent.mkdir(parents=True)
    file.path.write_text(file.text)
    config = read(file.path, environ={}).config
    assert config.serial.port == "/dev/serial/by-path/usb-0:1.2-port0"
    assert config.zenoh.namespace == "front"
    assert config.zenoh.listen == ("tcp/127.0.0.1:7449",)


@pytest.mark.parametrize(
    "name", ["", "config", "../etc/passwd", "a b", "1st", "a.b", "a-b", "é", "a\n"]
)
def test_names_that_no_instance_may_have(name: str) -> None:
    assert not install_plan.instance_name_is_good(name)


def test_what_every_user_may_read_is_in_reach() -> None:
    assert install_plan.unreachable([Path("/usr/bin/env"), Path("/bin/sh")]) is None


def test_a_program_that_the_service_does_not_see_is_out_of_reach(tmp_path: Path) -> None:
    assert install_plan.unreachable([Path("/home/pi/.local/bin/x")]) == Path(
        "/home/pi/.local/bin/x"
    )
    # Pytest's folder is the user's alone, and below /tmp besides.
    assert install_plan.unreachable([Path("/bin/sh"), tmp_path]) == tmp_path


def test_a_link_out_of_reach_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install_plan, "HIDDEN", (str(tmp_path / "home"),))
    (tmp_path / "home").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "home")
    assert install_plan.unreachable([tmp_path / "link"]) == tmp_path / "link"
