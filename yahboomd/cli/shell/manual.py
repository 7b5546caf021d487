"""Man pages, one for each command, made from its help. Pure."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping

import msgspec

from yahboomd import RELEASE
from yahboomd.cli.shell.command_tree import Argument, CommandNode

DATE = "2026-11-22"
"""The date of the pages, which changes with the version."""

ABOUT = """\
Owns the serial port of a 4-channel motor driver board, drives its wheels from velocity commands on
a Zenoh bus, and publishes exact odometry. As a service it starts at boot and when the board is
plugged in.
"""

FILES: Mapping[str, str] = {
    "/etc/yahboomd/config.toml": "the configuration; `yahboomd config reference` explains every "
    "key.",
    "/etc/yahboomd/NAME.toml": "that of the service yahboomd@NAME, if there are several boards.",
    "/dev/yahboom_driver": "the board, as the udev rule names it.",
    "/run/yahboomd/stop.sock": "the socket over which root and the group yahboomd stop the robot: "
    "`echo stop | socat - UNIX-CONNECT:/run/yahboomd/stop.sock`",
    "/run/yahboomd/estop*": "present while the emergency stop is engaged.",
}

STATUSES: Mapping[int, str] = {
    0: "success.",
    1: "the answer is no: the command refused or failed, or found that something is not so. Its "
    "own page explains it.",
    2: "the arguments make no sense.",
    3: "the emergency stop is engaged (`yahboomd status`).",
    4: "the robot waits for its board (`yahboomd status`).",
    65: "a file has another format than the command takes.",
    66: "a file cannot be read.",
    69: "no port, no board or no daemon is there, or another process holds the port.",
    70: "an error of yahboomd itself; the log has a traceback.",
    71: "the system allows a process too few files or threads, or too little memory.",
    74: "the output cannot be written: the disk is full.",
    73: "the file cannot be written.",
    75: "the daemon ended, and did not see the wheels stand: look at them.",
    77: "no permission.",
    78: "a mistake in the configuration, or in the board's settings, that a person must correct.",
    130: "Ctrl-C.",
    141: "the reader of the output has left.",
}
"""Every exit status of the program."""

ALWAYS = (2, 130)
"""The exit statuses that every command may end with."""

WIDTH = 70


class ManualSection(msgspec.Struct, frozen=True, kw_only=True):
    """A part of an epilog: a heading that ends with a colon, and the lines below it."""

    heading: str
    lines: tuple[str, ...]


def pages(top: CommandNode) -> dict[str, str]:
    """Every man page by its file's name."""
    return {"yahboomd.1": _first_page(top)} | {
        f"{'-'.join(command.words)}.1": _page(command) for command in top.commands
    }


def sections(epilog: str) -> list[ManualSection]:
    """Split an epilog at its headings; text without a heading has an empty one."""
    found: list[ManualSection] = []
    heading, lines = "", list[str]()

    def end() -> None:
        nonlocal heading, lines
        kept = "\n".join(lines).strip("\n")
        if kept:
            found.append(ManualSection(heading=heading, lines=tuple(kept.split("\n"))))
        heading, lines = "", []

    for line in epilog.splitlines():
        if line.endswith(":") and not line.startswith(" "):
            end()
            heading = line[:-1]
        elif line and not line.startswith(" ") and heading:
            end()
            lines.append(line)
        else:
            lines.append(line)
    end()
    return found


def exit_statuses(epilog: str) -> dict[int, str]:
    """The exit statuses that an epilog names."""
    found: dict[int, str] = {}
    for section in sections(epilog):
        if section.heading == "exit status":
            for number, words in re.findall(r"(?m)^  (\d+) +(.+(?:\n {4,}.+)*)", _text(section)):
                found[int(number)] = " ".join(words.split())
    return found


def _text(section: ManualSection) -> str:
    return "\n".join(section.lines)


def _first_page(top: CommandNode) -> str:
    lines = [*_head(top, "daemon for Yahboom encoder motor driver boards"), ".SH SYNOPSIS"]
    lines += [".B yahboomd", ".I COMMAND", ".RI [ options ]", ".SH DESCRIPTION", *_prose(ABOUT)]
    lines.append(".SH COMMANDS")
    for command in top.commands:
        lines += [".TP", f".BR {_escaped('-'.join(command.words))} (1)", *_prose(command.line)]
    lines += [".SH OPTIONS", *_arguments(top.options), ".SH FILES"]
    for name, words in FILES.items():
        lines += [".TP", f".I {_escaped(name)}", *_prose(words)]
    lines += [".SH EXIT STATUS", *_statuses(STATUSES)]
    return _joined([*lines, *_epilog(top.epilog), *_see_also(top.commands)])


def _page(command: CommandNode) -> str:
    lines = [*_head(command, command.line), ".SH SYNOPSIS"]
    for each in command.commands or (command,):
        lines += [".PP", *_synopsis(each)]
    lines += [".SH DESCRIPTION", *_prose(command.description)]
    for each in command.commands:
        lines += [f".SS {_escaped(' '.join(each.words))}", *_prose(each.description)]
        lines += _arguments(one for one in each.arguments if "--help" not in one.flags)
    for group in command.groups:
        usual = group.title in {"options", "positional arguments"}
        if group.title == "positional arguments":
            lines.append(".SH ARGUMENTS")
        elif usual:
            lines.append(".SH OPTIONS")
        else:
            title, _, more = group.title.partition(" (")
            lines.append(f".SS {_escaped(title[0].upper() + title[1:])}")
            lines += _prose(f"{more[0].upper()}{more[1:].rstrip(')')}.") if more else []
        lines += _arguments(group.arguments)
    own = exit_statuses(command.epilog)
    statuses = own | {each: STATUSES[each] for each in ALWAYS if each not in own}
    lines += [*_epilog(command.epilog), ".SH EXIT STATUS", *_statuses(statuses)]
    return _joined([*lines, *_see_also()])


def _joined(lines: list[str]) -> str:
    # A heading begins a paragraph by itself.
    return re.sub(r"(?m)^(\.S[HS] .*\n)\.PP\n", r"\1", "\n".join(lines)) + "\n"


def _head(command: CommandNode, line: str) -> list[str]:
    name = "-".join(command.words)
    return [
        f'.TH {_escaped(name.upper())} 1 {DATE} "yahboomd {RELEASE}" "User commands"',
        ".SH NAME",
        f"{_escaped(name)} \\- {_escaped(line)}",
    ]


def _synopsis(command: CommandNode) -> list[str]:
    lines = [f".B {_escaped(' '.join(command.words))}"]
    shown: set[str] = {"--help"}
    for argument in (*command.options, *command.positionals):
        if shown.isdisjoint(argument.flags):
            beside = [each for each in command.options if set(each.flags) & set(argument.excludes)]
            group = (argument, *beside)
            words = " | ".join(_signature(each, each.flags[-1:]) for each in group)
            lines.append(words if argument.required else f"[{words}]")
            shown |= {flag for each in group for flag in each.flags}
    return lines


def _signature(argument: Argument, flags: Iterable[str]) -> str:
    values = [_escaped(value or f"{{{','.join(argument.choices)}}}") for value in argument.values]
    shown = " ".join(f"\\fI{value}\\fP" for value in values)
    named = ", ".join(f"\\fB{_escaped(flag)}\\fP" for flag in flags)
    return " ".join(filter(None, (named, shown)))


def _arguments(arguments: Iterable[Argument]) -> list[str]:
    lines = []
    for argument in arguments:
        lines += [".TP", _signature(argument, argument.flags), *_prose(f"{argument.help}.")]
    return lines


def _statuses(statuses: Mapping[int, str]) -> list[str]:
    lines = []
    for number, words in sorted(statuses.items()):
        lines += [".TP", f".B {number}", *_prose(words)]
    return lines


def _epilog(epilog: str) -> list[str]:
    """An epilog without its exit statuses, examples first."""
    examples: list[str] = []
    others: list[str] = []
    notes: list[str] = []
    for section in sections(epilog):
        if not section.heading:
            notes += _prose(_text(section))
        elif section.heading == "exit status":
            continue
        elif any("yahboomd " in line for line in section.lines):
            if section.heading not in {"example", "examples"}:
                examples += [".PP", *_prose(f"{section.heading}:")]
            examples += _block(section.lines)
        else:
            title, _, more = section.heading.partition(", ")
            others.append(f".SH {_escaped(title.upper())}")
            others += _prose(f"{more}:") if more else []
            others += _block(section.lines)
    lines = [".SH EXAMPLES", *examples] if examples else []
    lines += others
    return [*lines, ".SH NOTES", *notes] if notes else lines


def _block(lines: Iterable[str]) -> list[str]:
    text = textwrap.dedent("\n".join(lines))
    return [".PP", ".nf", ".RS 2", *map(_escaped, text.split("\n")), ".RE", ".fi"]


def _see_also(commands: Iterable[CommandNode] = ()) -> list[str]:
    names = ["-".join(command.words) for command in commands] or ["yahboomd"]
    shown = [f".BR {_escaped(name)} (1)," for name in names]
    return [".SH SEE ALSO", *shown, ".BR systemctl (1),", ".I /usr/share/doc/yahboomd/README.md"]


def _prose(text: str) -> list[str]:
    """Text in lines for roff to fill, a sentence on each; words in backquotes become bold."""
    lines: list[str] = []
    for sentence in re.split(r"(?<=[.:?]) +(?=[A-Z`])", " ".join(text.split())):
        lines += map(_escaped, textwrap.wrap(sentence, WIDTH, break_on_hyphens=False))
    marked = re.sub(r"`([^`]+)`", r"\\fB\1\\fP", "\n".join(lines), flags=re.DOTALL)
    return re.sub(r"\.\.$", ".", marked, flags=re.MULTILINE).split("\n")


def _escaped(text: str) -> str:
    """Text that roff prints unchanged."""
    text = text.replace("\\", "\\e").replace("-", "\\-")
    return f"\\&{text}" if text.startswith((".", "'")) else text
