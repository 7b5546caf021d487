"""Man pages: complete, and without a mistake that a formatter finds."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from yahboomd.cli.shell.command_tree import CommandNode, whole
from yahboomd.cli.shell.manual import STATUSES, exit_statuses, pages, sections
from yahboomd.core import errors
from yahboomd.core.program import COMMANDS


@pytest.fixture(scope="module")
def top() -> CommandNode:
    return whole()


@pytest.fixture(scope="module")
def texts(top: CommandNode) -> dict[str, str]:
    return pages(top)


def formatted(text: str, *command: str) -> str:
    """The page as a person reads it, its lines joined."""
    if shutil.which(command[0]) is None:
        pytest.skip(f"there is no {command[0]} on this machine")
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return " ".join(re.sub(r"\x1b\[[0-9]*m|.\x08", "", done.stdout).split())


def test_every_command_has_a_page(texts: dict[str, str]) -> None:
    assert list(texts) == ["yahboomd.1", *(f"yahboomd-{name}.1" for name in COMMANDS)]


def test_the_first_page_names_every_command_and_every_exit_status(texts: dict[str, str]) -> None:
    commands, statuses = texts["yahboomd.1"].split(".SH EXIT STATUS")
    named = re.findall(r"^\.BR yahboomd\\-([\w\\-]+) \(1\)$", commands, re.MULTILINE)
    assert named == list(COMMANDS)
    codes = {
        value.exit_code
        for value in vars(errors).values()
        if isinstance(value, type) and issubclass(value, errors.YahboomdError)
    }
    found = set(map(int, re.findall(r"^\.B (\d+)$", statuses, re.MULTILINE)))
    assert codes | {0, 1, 2, 75, 130} <= found


@pytest.mark.parametrize("name", COMMANDS)
def test_a_page_has_examples_and_exit_statuses_that_are_known(name: str, top: CommandNode) -> None:
    command = next(each for each in top.commands if each.words[-1] == name)
    examples = [each for each in sections(command.epilog) if "yahboomd " in "".join(each.lines)]
    assert examples
    assert 0 in exit_statuses(command.epilog)
    assert set(exit_statuses(command.epilog)) <= set(STATUSES)


def test_every_option_is_on_the_page_of_its_command(
    top: CommandNode, texts: dict[str, str]
) -> None:
    for command in top.commands:
        page = texts[f"{'-'.join(command.words)}.1"].replace("\\-", "-")
        for each in command.walk():
            for option in each.options:
                assert f"\\fB{option.flags[-1]}\\fP" in page


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["", *(f"-{name}" for name in COMMANDS)])
def test_mandoc_finds_nothing_to_complain_of(name: str, texts: dict[str, str]) -> None:
    text = texts[f"yahboomd{name}.1"]
    assert formatted(text, "mandoc", "-T", "lint", "-W", "style") == ""


def test_an_epilog_is_split_at_its_headings() -> None:
    epilog = (
        "examples:\n  a b\n\n  c\n\nRead this.\n\n"
        "exit status:\n  0    fine,\n       or so\n  69   none\n"
    )
    assert [(each.heading, each.lines) for each in sections(epilog)] == [
        ("examples", ("  a b", "", "  c")),
        ("", ("Read this.",)),
        ("exit status", ("  0    fine,", "       or so", "  69   none")),
    ]
    assert exit_statuses(epilog) == {0: "fine, or so", 69: "none"}
