"""The command line as data."""

from __future__ import annotations

import argparse

import pytest

from yahboomd.cli.shell.command_tree import CommandNode, describe, whole
from yahboomd.core.program import COMMANDS


@pytest.fixture
def top() -> CommandNode:
    parser = argparse.ArgumentParser(prog="robot", description="Drives.", epilog="examples:\n  x")
    commands = parser.add_subparsers()
    go = commands.add_parser("go", help="drive off")
    go.add_argument("where", metavar="PLACE", choices=("home", "away"), help="where to")
    go.add_argument("--map", metavar="FILE", help="the map (default: %(default)s)", default="none")
    go.add_argument("--via", nargs=2, metavar=("X", "Y"), action="append", help="pass here")
    go.add_argument("--secret", help=argparse.SUPPRESS)
    pace = go.add_mutually_exclusive_group()
    pace.add_argument("--fast", action="store_true")
    pace.add_argument("--slow", action="store_true")
    return describe(parser)


def test_a_command_is_named_by_what_is_typed(top: CommandNode) -> None:
    assert [command.words for command in top.walk()] == [("robot",), ("robot", "go")]
    assert top.commands[0].line == "drive off"
    assert (top.description, top.epilog) == ("Drives.", "examples:\n  x")


def test_an_option_has_its_flags_its_values_and_its_help(top: CommandNode) -> None:
    options = {option.flags[-1]: option for option in top.commands[0].options}
    assert options["--map"].help == "the map (default: none)"
    assert (options["--map"].kind, options["--map"].values) == ("file", ("FILE",))
    assert (options["--via"].values, options["--via"].repeats) == (("X", "Y"), True)
    assert (options["--help"].kind, options["--help"].values) == ("nothing", ())
    assert options["--fast"].excludes == ("--slow",)


def test_a_positional_argument_has_its_choices(top: CommandNode) -> None:
    [argument] = top.commands[0].positionals
    assert (argument.values, argument.choices, argument.kind) == (
        ("PLACE",),
        ("home", "away"),
        "choice",
    )
    assert argument.required


def test_what_the_help_hides_is_hidden_here(top: CommandNode) -> None:
    assert "--secret" not in {flag for each in top.commands[0].options for flag in each.flags}


def test_the_whole_command_line_has_every_command_with_its_line() -> None:
    assert {each.words[-1]: each.line for each in whole().commands} == COMMANDS
