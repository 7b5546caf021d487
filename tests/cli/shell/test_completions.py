"""Completions that real shells offer with the scripts that are made for them."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from completing_shell import Shell, shell

from yahboomd.cli.main import main
from yahboomd.cli.shell.command_tree import whole
from yahboomd.cli.shell.completions import SCRIPTS
from yahboomd.core.program import COMMANDS

__all__ = ["shell"]

pytestmark = pytest.mark.realtime


def test_every_command_is_offered(shell: Shell) -> None:
    assert shell.complete("yahboomd ") == sorted(COMMANDS)


def test_every_option_of_a_command_is_offered_and_none_of_another(shell: Shell) -> None:
    offered = set(shell.complete("yahboomd stop --"))
    assert offered >= {"--direct", "--release", "--port", "--set"}
    assert not offered & {"--once", "--version", "--origin"}


def test_words_that_an_option_takes_are_offered(shell: Shell) -> None:
    assert shell.complete("yahboomd simulate --dialect ") == ["polled", "rosmaster", "streamed"]
    assert shell.complete("yahboomd completions ") == ["bash", "fish", "zsh"]
    assert shell.complete("yahboomd call odometry/") == ["odometry/reset", "odometry/set_pose"]


def test_files_are_offered_where_an_option_takes_one(shell: Shell) -> None:
    assert shell.complete("yahboomd run --config rob") == ["robot.toml"]


def test_the_value_of_an_option_is_not_taken_for_a_command(shell: Shell) -> None:
    assert "--linear" in shell.complete("yahboomd drive --namespace stop --l")


@pytest.mark.parametrize("name", ["bash", "zsh", "fish"])
def test_a_shell_finds_no_mistake_in_its_script(name: str) -> None:
    if shutil.which(name) is None:
        pytest.skip(f"there is no {name} on this machine")
    flags = ["--no-config", "--no-execute"] if name == "fish" else ["-n"]
    done = subprocess.run(
        [name, *flags],
        input=SCRIPTS[name](whole()),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("shell", SCRIPTS)
def test_it_prints_the_script_of_a_shell(shell: str, capsys) -> None:
    assert main(["completions", shell]) == 0
    assert capsys.readouterr().out == SCRIPTS[shell](whole(installed=True))
