"""`yahboomd install`: into a folder, and its commands for a live system."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from yahboomd.cli import install as command
from yahboomd.cli.install import System, install
from yahboomd.cli.main import main
from yahboomd.tools.service import install_plan

UNIT = "etc/systemd/system/yahboomd.service"


class Commands:
    """Stands for the machine: remembers the commands; those in ``failing`` fail."""

    def __init__(self, *failing: str) -> None:
        self.ran: list[str] = []
        self._failing = failing

    def __call__(self, words: Sequence[str]) -> int:
        self.ran.append(" ".join(words))
        return 1 if words[1] in self._failing else 0


def system(root: Path, run: Commands, **changes: object) -> System:
    usual = System(
        root=root,
        program=Path("/opt/robot/bin/yahboomd"),
        packaged=False,
        live=False,
        run=run,
        dry=False,
    )
    return usual._replace(**changes)  # type: ignore[arg-type]


def tree(root: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(root)): path.read_bytes()
        for path in root.rglob("*")
        if path.is_file() and not path.is_symlink()
    }


@pytest.fixture
def as_root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(command.os, "geteuid", lambda: 0)


def test_the_command_line_installs_into_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install", "--root", str(tmp_path)]) == 0
    assert (tmp_path / UNIT).stat().st_mode & 0o777 == 0o644
    assert (tmp_path / "etc/yahboomd/config.toml").exists()
    assert "Nothing is started" in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["install", "uninstall"])
@pytest.mark.parametrize("link", ["etc", "etc/systemd", "usr/local"])
def test_a_link_that_leads_out_of_the_root_is_refused_and_not_followed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str, link: str
) -> None:
    """An absolute link in the image of another machine leads to this machine's folder."""
    outside, root = tmp_path / "outside", tmp_path / "root"
    outside.mkdir()
    (root / link).parent.mkdir(parents=True)
    (root / link).symlink_to(outside)
    assert main([verb, "--root", str(root)]) not in {0, None}
    assert f"{outside}" in capsys.readouterr().err
    assert list(outside.iterdir()) == []


def test_a_relative_link_below_the_root_is_followed(tmp_path: Path) -> None:
    (tmp_path / "var/usrlocal").mkdir(parents=True)
    (tmp_path / "usr").mkdir()
    (tmp_path / "usr/local").symlink_to("../var/usrlocal")
    assert main(["install", "--root", str(tmp_path)]) == 0
    assert (tmp_path / "var/usrlocal/share/man/man1/yahboomd-stop.1").exists()


def test_a_dry_run_changes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = Commands()
    assert install(system(tmp_path, run, dry=True, live=True)) == 0
    said = capsys.readouterr().out
    assert tree(tmp_path) == {}
    assert run.ran == []
    assert f"would write  {tmp_path / UNIT}" in said
    assert "would run    systemctl enable yahboomd.service" in said


def test_a_second_time_changes_nothing_and_says_so(
    tmp_path: Path, as_root: None, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Commands()
    install(system(tmp_path, run, live=True))
    (tmp_path / "etc/yahboomd/config.toml").write_text("# mine\n")
    before = tree(tmp_path)
    first = run.ran[:]
    run.ran.clear()
    capsys.readouterr()

    assert install(system(tmp_path, run, live=True)) == 0

    assert tree(tmp_path) == before
    assert "kept, it is yours" in capsys.readouterr().out
    # A robot that drives is not stopped for nothing.
    assert "systemctl restart yahboomd.service" in first
    assert "systemctl restart yahboomd.service" not in run.ran
    assert "systemctl start yahboomd.service" in run.ran


def test_man_pages_and_completions_are_put_in_place_and_restart_nothing(
    tmp_path: Path, as_root: None, capsys: pytest.CaptureFixture[str]
) -> None:
    install(system(tmp_path, Commands(), live=True))
    share = tmp_path / "usr/local/share"
    assert (share / "man/man1/yahboomd-stop.1").read_text().startswith(".TH YAHBOOMD")
    (share / "zsh/site-functions/_yahboomd").write_text("of an older version\n")
    fish = tmp_path / "etc/fish/completions/yahboomd.fish"
    fish.unlink()
    capsys.readouterr()
    run = Commands()

    assert install(system(tmp_path, run, live=True)) == 0

    assert (share / "zsh/site-functions/_yahboomd").read_text().startswith("#compdef yahboomd")
    assert fish.read_text().startswith("#")
    assert f"unchanged    {share}/man/man1" in capsys.readouterr().out
    assert "systemctl start yahboomd.service" in run.ran


def test_a_service_that_does_not_start_is_no_success(
    tmp_path: Path, as_root: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert install(system(tmp_path, Commands("restart"), live=True)) == 1
    assert "does not run yet" in capsys.readouterr().err


def test_without_root_nothing_is_touched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command.os, "geteuid", lambda: 1000)
    run = Commands()
    assert install(system(tmp_path, run, live=True)) == 77
    assert tree(tmp_path) == {}
    assert run.ran == []
    assert "sudo" in capsys.readouterr().err


def test_an_instance_gets_its_configuration_and_its_service(tmp_path: Path, as_root: None) -> None:
    run = Commands()
    assert install(system(tmp_path, run, live=True), instance="front", port="/dev/ttyUSB3") == 0
    assert 'port = "/dev/ttyUSB3"' in (tmp_path / "etc/yahboomd/front.toml").read_text()
    assert "systemctl enable yahboomd@front.service" in run.ran
    assert "systemctl enable yahboomd.service" not in run.ran


def test_beside_the_debian_package_only_the_instance_is_written(
    tmp_path: Path, as_root: None
) -> None:
    run = Commands()
    done = install(
        system(tmp_path, run, live=True, packaged=True), instance="front", port="/dev/ttyUSB3"
    )
    assert done == 0
    assert set(tree(tmp_path)) == {"etc/yahboomd/front.toml"}


@pytest.mark.parametrize(
    ("instance", "port", "words"),
    [
        (None, "/dev/ttyUSB0", "--port is for --instance"),
        ("front", None, "needs its --port"),
        ("../x", "/dev/ttyUSB0", "--instance takes a name"),
        ("front", "ttyUSB0", "--port takes an absolute path"),
        ("front", '/dev/"', "--port takes an absolute path"),
    ],
)
def test_what_cannot_be_is_refused_in_words(
    tmp_path: Path,
    instance: str | None,
    port: str | None,
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert install(system(tmp_path, Commands()), instance=instance, port=port) == 78
    assert words in capsys.readouterr().err
    assert tree(tmp_path) == {}


def test_a_program_that_the_services_user_cannot_read_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Commands()
    program = Path("/home/pi/.local/share/uv/tools/yahboomd/bin/yahboomd")
    done = install(system(Path("/"), run, dry=True)._replace(program=program))
    assert done == 78
    said = capsys.readouterr().err
    assert str(program) in said
    assert "UV_TOOL_DIR=/opt/uv/tools" in said


def test_the_page_is_reached_from_elsewhere_where_a_person_says_so(
    tmp_path: Path, as_root: None, capsys: pytest.CaptureFixture[str]
) -> None:
    run = Commands()
    assert install(system(tmp_path, run, live=True), web=True, listen="0.0.0.0:8480") == 0
    text = (tmp_path / install_plan.WEB_LISTEN).read_text()
    assert 'Environment="WEB_OPTIONS=--listen 0.0.0.0:8480"' in text
    assert "IPAddressDeny=\n" in text
    assert "sudo yahboomd web --show-link" in capsys.readouterr().out
    assert run.ran.index("systemctl daemon-reload") < len(run.ran) - 2
    again = Commands()
    install(system(tmp_path, again, live=True, packaged=True), web=True, listen="0.0.0.0:9000")
    assert again.ran[-3:] == [
        "systemctl daemon-reload",
        "systemctl enable yahboomd-web.service",
        "systemctl restart yahboomd-web.service",
    ]


@pytest.mark.parametrize(
    ("web", "listen", "instance", "words"),
    [
        (False, "0.0.0.0:8480", None, "--listen is for --web"),
        (True, "here", None, "--listen takes an address and a port"),
        (True, '0.0.0.0:8480"', None, "--listen takes an address and a port"),
        (True, None, "front", "--web is for one board"),
    ],
)
def test_a_page_that_cannot_be_is_refused_in_words(
    tmp_path: Path,
    web: bool,
    listen: str | None,
    instance: str | None,
    words: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    port = "/dev/ttyUSB0" if instance else None
    done = install(
        system(tmp_path, Commands()), web=web, listen=listen, instance=instance, port=port
    )
    assert done == 78
    assert words in capsys.readouterr().err
    assert tree(tmp_path) == {}
