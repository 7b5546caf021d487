"""Commands that other packages bring."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from yahboomd.cli import packages
from yahboomd.cli.main import main
from yahboomd.core.program import install_command

COMMAND = """
DESCRIPTION, EPILOG = "Wave.", ""
def add_options(parser):
    parser.add_argument("--times", type=int)
def run(args):
    return args.times
"""


@pytest.fixture
def waving(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package with a command, and one that takes the name of a command of yahboomd."""
    about = tmp_path / "robot_wave-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: robot-wave\nVersion: 1.0\nSummary: wave to people\n")
    (about / "entry_points.txt").write_text(
        "[yahboomd.commands]\nrobotwave = robot_wave\nstop = robot_wave\nbroken = robot_none\n"
    )
    (tmp_path / "robot_wave.py").write_text(COMMAND)
    monkeypatch.syspath_prepend(tmp_path)


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "entry_points", lambda **_: ())


@pytest.mark.usefixtures("waving")
def test_a_package_brings_a_command_with_its_options_its_line_and_its_completion(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["robotwave", "--times", "3"]) == 3
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "    robotwave    wave to people\n" in capsys.readouterr().out


@pytest.mark.usefixtures("waving")
def test_no_package_replaces_a_command_of_yahboomd(capsys: pytest.CaptureFixture[str]) -> None:
    assert "stop" not in packages.commands()
    with pytest.raises(SystemExit):
        main(["stop", "--help"])
    assert "Stop the wheels" in capsys.readouterr().out


@pytest.mark.usefixtures("waving")
def test_a_package_with_a_part_that_is_gone_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["broken"]) == 69
    assert "needs the Python package robot_none, which is missing" in capsys.readouterr().err


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("words", [["fleet", "stop"], ["fleet"], ["web", "--fleet", "anna.json5"]])
def test_without_the_package_the_way_to_install_it_is_named_in_one_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 69
    said = f"yahboomd: `{words[0]}` needs yahboomd-fleet: {install_command('fleet')}\n"
    assert capsys.readouterr() == ("", said)


@pytest.mark.usefixtures("alone")
def test_a_word_that_is_no_command_is_a_mistake(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["fly"])
    assert left.value.code == 2
    assert "invalid choice: 'fly'" in capsys.readouterr().err


def test_a_stop_looks_for_no_package(tmp_path: Path) -> None:
    script = (
        "import sys; from yahboomd.cli.main import main\n"
        f"assert main(['stop', '--direct', '--port', '{tmp_path}/none']) == 69\n"
        "print({'yahboomd.cli.packages', 'importlib.metadata'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "set()\n"
