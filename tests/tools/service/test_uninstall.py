"""`yahboomd uninstall`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from yahboomd.cli import uninstall as command
from yahboomd.cli.install import System, install
from yahboomd.cli.main import main
from yahboomd.cli.uninstall import uninstall


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setattr(command.os, "geteuid", lambda: 0)
    return []


@pytest.fixture
def system(tmp_path: Path, ran: list[str]) -> System:
    def run(words: Sequence[str]) -> int:
        ran.append(" ".join(words))
        return 0

    made = System(
        root=tmp_path,
        program=Path("/opt/robot/bin/yahboomd"),
        packaged=False,
        live=True,
        run=run,
        dry=False,
    )
    install(made)
    install(made, instance="front", port="/dev/ttyUSB3")
    ran.clear()
    return made


def files(root: Path) -> list[str]:
    return sorted(str(path.relative_to(root)) for path in root.rglob("*") if path.is_file())


def test_only_what_a_person_may_have_written_is_left(system: System) -> None:
    assert uninstall(system) == 0
    assert files(system.root) == ["etc/yahboomd/config.toml", "etc/yahboomd/front.toml"]


def test_services_are_stopped_while_their_units_are_known(system: System, ran: list[str]) -> None:
    wants = system.root / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir()
    (wants / "yahboomd@front.service").symlink_to("/dev/null")
    uninstall(system)
    names = (
        "yahboomd",
        "yahboomd@front",
        *(f"yahboomd-{each}" for each in ("metrics", "moves", "web")),
    )
    units = " ".join(f"{name}.service" for name in names)
    assert ran[0] == f"systemctl disable --now {units}"
    assert "systemctl daemon-reload" in ran[1:]


def test_one_instance_ends_and_the_others_stay(system: System, ran: list[str]) -> None:
    before = files(system.root)
    assert uninstall(system, instance="front") == 0
    assert ran == ["systemctl disable --now yahboomd@front.service"]
    assert files(system.root) == before


def test_what_dpkg_brought_dpkg_takes_away(
    system: System, ran: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert uninstall(system._replace(packaged=True)) == 78
    assert ran == []
    assert "apt remove yahboomd" in capsys.readouterr().err


def test_the_command_line_uninstalls_from_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["install", "--root", str(tmp_path)])
    assert main(["uninstall", "--root", str(tmp_path)]) == 0
    assert files(tmp_path) == ["etc/yahboomd/config.toml"]
    assert "Kept: /etc/yahboomd" in capsys.readouterr().out
