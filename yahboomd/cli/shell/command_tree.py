"""The command line as data: every command with its options, for man pages and completions."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Literal

import msgspec

Kind = Literal["nothing", "file", "folder", "choice", "value"]

FILES = frozenset({"FILE", "PATH"})
FOLDERS = frozenset({"DIR", "FOLDER"})


class Argument(msgspec.Struct, frozen=True, kw_only=True):
    """An option, or a positional argument.

    Attributes:
        flags: ``("-h", "--help")``; none for a positional argument.
        values: The names of its values, such as ``("FILE",)``.
        kind: The kind of its values, for completion.
        choices: The words that it takes, if they are known.
        excludes: Options that cannot be given with it.
    """

    flags: tuple[str, ...]
    values: tuple[str, ...]
    kind: Kind
    choices: tuple[str, ...]
    help: str
    required: bool
    repeats: bool
    excludes: tuple[str, ...]


class Group(msgspec.Struct, frozen=True, kw_only=True):
    """Arguments below one heading of the help."""

    title: str
    arguments: tuple[Argument, ...]


class CommandNode(msgspec.Struct, frozen=True, kw_only=True):
    """A command, or one of its verbs.

    Attributes:
        words: The typed words: ``("yahboomd", "config", "check")``.
        line: Its line in the list of commands.
        epilog: Examples, exit statuses and notes.
    """

    words: tuple[str, ...]
    line: str
    description: str
    epilog: str
    groups: tuple[Group, ...]
    commands: tuple[CommandNode, ...]

    @property
    def arguments(self) -> tuple[Argument, ...]:
        """All of its arguments."""
        return tuple(argument for group in self.groups for argument in group.arguments)

    @property
    def options(self) -> tuple[Argument, ...]:
        """The arguments that have flags."""
        return tuple(argument for argument in self.arguments if argument.flags)

    @property
    def positionals(self) -> tuple[Argument, ...]:
        """The arguments without flags."""
        return tuple(argument for argument in self.arguments if not argument.flags)

    def walk(self) -> Iterator[CommandNode]:
        """This command and every one below it."""
        yield self
        for command in self.commands:
            yield from command.walk()


def describe(parser: argparse.ArgumentParser, line: str = "") -> CommandNode:
    """Read a parser into data."""
    formatter = parser._get_formatter()  # noqa: SLF001 - argparse has no public way to its parts

    def words_of(action: argparse.Action) -> str:
        text = formatter._expand_help(action) if action.help else ""  # noqa: SLF001
        return " ".join(text.split())

    excludes: dict[argparse.Action, tuple[str, ...]] = {}
    for exclusive in parser._mutually_exclusive_groups:  # noqa: SLF001
        for action in exclusive._group_actions:  # noqa: SLF001
            excludes[action] = tuple(
                flag
                for other in exclusive._group_actions  # noqa: SLF001
                if other is not action
                for flag in other.option_strings
            )
    commands: tuple[CommandNode, ...] = ()
    groups = []
    for group in parser._action_groups:  # noqa: SLF001
        arguments = []
        for action in group._group_actions:  # noqa: SLF001
            if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
                lines = {each.dest: each.help or "" for each in action._choices_actions}  # noqa: SLF001
                commands = tuple(
                    describe(each, lines.get(name, "")) for name, each in action.choices.items()
                )
            elif action.help != argparse.SUPPRESS:
                arguments.append(_argument(action, words_of(action), excludes.get(action, ())))
        if arguments:
            groups.append(Group(title=group.title or "", arguments=tuple(arguments)))
    return CommandNode(
        words=tuple(parser.prog.split()),
        line=line,
        description=parser.description or "",
        epilog=parser.epilog or "",
        groups=tuple(groups),
        commands=commands,
    )


def _argument(action: argparse.Action, help_text: str, excludes: tuple[str, ...]) -> Argument:
    choices = tuple(map(str, action.choices or ()))
    names: tuple[str, ...] = ()
    if action.nargs != 0:
        metavar = action.metavar or ("" if choices else action.dest.upper())
        names = (metavar,) if isinstance(metavar, str) else metavar
    return Argument(
        flags=tuple(action.option_strings),
        values=names,
        kind=_kind(names, choices),
        choices=choices,
        help=help_text,
        required=action.required,
        repeats=isinstance(action, argparse._AppendAction),  # noqa: SLF001
        excludes=excludes,
    )


def _kind(names: tuple[str, ...], choices: tuple[str, ...]) -> Kind:
    if not names:
        return "nothing"
    if choices:
        return "choice"
    if names[0] in FILES:
        return "file"
    return "folder" if names[0] in FOLDERS else "value"


def whole(*, installed: bool = False) -> CommandNode:
    """The whole command line of yahboomd; ``installed``: also of the packages beside it."""
    from yahboomd.cli.main import whole_parser

    return describe(whole_parser(installed=installed))
