"""The installed package is found, and pages and its man page agree with it. Quick."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec
import pytest

from tests.test_pages import WRITTEN, wrong_options
from yahboomd.cli import packages
from yahboomd.cli.main import main
from yahboomd.cli.shell import command_tree
from yahboomd.cli.shell.shared_files import shared_files
from yahboomd_fleet.fleet_plan import FleetPlan, plan_problem
from yahboomd_fleet.page_fleet import PageFleet

FOLDER = Path(__file__).resolve().parents[1]
PAGES = [*WRITTEN, FOLDER / "README.md"]


def test_the_installed_package_brings_its_command_and_its_part_of_the_page(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as left:
        main(["fleet", "stop", "--help"])
    assert left.value.code == 0
    assert "until each acknowledged" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "    fleet        make certificates" in capsys.readouterr().out
    assert packages.page_part("fleet") is PageFleet


def test_its_verbs_are_completed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completions", "bash"]) == 0
    words = 'words="init add renew revoke check status stop"'
    assert words in capsys.readouterr().out


def test_its_man_page_is_what_its_options_make_of_it() -> None:
    for name, text in shared_files("fleet").items():
        assert (FOLDER / "share" / name).read_text() == text, "run `make schemas`"


def test_every_command_of_it_that_a_page_shows_exists() -> None:
    commands = {
        command.words: command
        for command in command_tree.whole(installed=True).walk()
        if command.words[1:2] in ((), ("fleet",))
    }
    shown = 0
    for page in PAGES:
        for line in re.findall(r"yahboomd fleet [^`\n]*", page.read_text()):
            assert not wrong_options(line, commands), (page, line)
            shown += 1
    assert shown > 5


def test_every_list_of_a_fleet_on_a_page_is_one() -> None:
    blocks = [
        tomllib.loads(block)
        for page in PAGES
        for block in re.findall(r"```toml\n(.*?)```", page.read_text(), re.DOTALL)
    ]
    fleets = [block for block in blocks if "fleet" in block]
    assert len(fleets) > 1
    for fleet in fleets:
        assert plan_problem(msgspec.convert(fleet, FleetPlan)) == ""
