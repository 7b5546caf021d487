"""``yahboomd completions``: scripts that complete commands and options in bash, zsh and fish."""

from __future__ import annotations

import argparse
import os
import re
import shlex
from collections.abc import Callable, Mapping

from yahboomd.cli.shell.command_tree import Argument, CommandNode, whole

DESCRIPTION = """\
Print a script that lets a shell complete the commands and options of yahboomd. The Debian package
and `yahboomd install` put these scripts in place; after another installation, load one.
"""

EPILOG = """\
examples:
  source <(yahboomd completions bash)                 in ~/.bashrc
  source <(yahboomd completions zsh)                  in ~/.zshrc, below compinit
  yahboomd completions fish > ~/.config/fish/completions/yahboomd.fish

exit status:
  0    the script was printed
"""

NOTE = "# Made from the options of yahboomd by `make schemas`."

BASH = """\
{note}
_yahboomd() {{
    local cur=${{COMP_WORDS[COMP_CWORD]}} prev=${{COMP_WORDS[COMP_CWORD - 1]}}
    local at="" word index options="" words=""
    COMPREPLY=()
    if [[ $cur == "=" ]]; then
        cur=""
    elif [[ $prev == "=" ]]; then
        prev=${{COMP_WORDS[COMP_CWORD - 2]}}
    fi
    for ((index = 1; index < COMP_CWORD; index++)); do
        word=${{COMP_WORDS[index]}}
        [[ $word == -* ]] && continue
        case "$at $word" in
            {known}) at="$at $word" ;;
            *) break ;;
        esac
    done
    case "$at $prev" in
{values}
    esac
    case "$at" in
{commands}
    esac
    if [[ $cur == -* || -z $words ]]; then
        words=$options
    fi
    COMPREPLY=($(compgen -W "$words" -- "$cur"))
}}
complete -F _yahboomd yahboomd
"""

ZSH = """\
#compdef yahboomd
{note}
{functions}
if [[ ${{funcstack[1]}} == _yahboomd ]]; then
    _yahboomd "$@"
else
    compdef _yahboomd yahboomd
fi
"""

ZSH_COMMANDS = """\
{name}() {{
    local context state state_descr line
    typeset -A opt_args
    _arguments -C \\
{options} \\
        '1:command:->command' \\
        '*::argument:->argument'
    case $state in
        command)
            local -a commands=(
{lines}
            )
            _describe -t commands command commands
            ;;
        argument)
            case $line[1] in
{calls}
            esac
            ;;
    esac
}}
"""

FISH = """\
{note}
function __yahboomd_at --description 'Whether the command typed so far is the one that is given'
    set -l words (commandline -opc)
    set -l named (string match -v -- '-*' $words[2..-1])
    test (count $named) -ge (count $argv); or return 1
    test (count $argv) -eq 0; or test "$named[1..$(count $argv)]" = "$argv"
end
function __yahboomd_ends --description 'Whether nothing but this command is typed so far'
    set -l words (commandline -opc)
    set -l named (string match -v -- '-*' $words[2..-1])
    test "$named" = "$argv"
end
complete -c yahboomd -f
{lines}
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "shell", metavar="SHELL", choices=("bash", "zsh", "fish"), help="bash, zsh or fish"
    )


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    print(SCRIPTS[args.shell](whole(installed=True)), end="")
    return os.EX_OK


def bash(top: CommandNode) -> str:
    """The script for bash."""
    known: list[str] = []
    commands: list[str] = []
    values: dict[str, list[str]] = {}
    for command in top.walk():
        at = "".join(f" {word}" for word in command.words[1:])
        if at:
            known.append(shlex.quote(at))
        options = " ".join(flag for option in command.options for flag in option.flags)
        words = " ".join(each.words[-1] for each in command.commands) or " ".join(
            choice for each in command.positionals for choice in each.choices
        )
        commands.append(f'        {shlex.quote(at)}) options="{options}" words="{words}" ;;')
        for option in command.options:
            if option.kind != "nothing":
                names = [shlex.quote(f"{at} {flag}") for flag in option.flags]
                values.setdefault(_bash_value(option), []).extend(names)
    return BASH.format(
        note=NOTE,
        known="|".join(known),
        values="\n".join(
            f"        {'|'.join(names)}) {how}return ;;" for how, names in values.items()
        ),
        commands="\n".join(commands),
    )


def _bash_value(option: Argument) -> str:
    match option.kind:
        case "file":
            # Readline's own completion of files handles paths with a colon.
            return "compopt -o default; "
        case "folder":
            return "compopt -o dirnames; "
        case "choice":
            return f'COMPREPLY=($(compgen -W "{" ".join(option.choices)}" -- "$cur")); '
        case _:
            return ""


def zsh(top: CommandNode) -> str:
    """The script for zsh."""
    functions = []
    for command in reversed(list(top.walk())):
        name = _zsh_name(command)
        arguments = [*map(_zsh_option, command.options), *map(_zsh_positional, command.positionals)]
        lines = " \\\n".join(f"        {each}" for each in arguments)
        if command.commands:
            functions.append(
                ZSH_COMMANDS.format(
                    name=name,
                    options=lines,
                    lines="\n".join(
                        f"                {_single(f'{each.words[-1]}:{each.line}')}"
                        for each in command.commands
                    ),
                    calls="\n".join(
                        f"                {each.words[-1]}) {_zsh_name(each)} ;;"
                        for each in command.commands
                    ),
                )
            )
        else:
            functions.append(f"{name}() {{\n    _arguments \\\n{lines}\n}}\n")
    return ZSH.format(note=NOTE, functions="".join(functions))


def _zsh_name(command: CommandNode) -> str:
    return "_" + "_".join(command.words)


def _zsh_option(option: Argument) -> str:
    words = re.sub(r"([\[\]\\:])", r"\\\1", _short(option.help))
    choices = f"({' '.join(option.choices)})"
    kinds = {"file": "_files", "folder": "_path_files -/", "choice": choices}
    values = "".join(
        f":{value.replace(':', ' ') or 'value'}:{kinds.get(option.kind, ' ')}"
        for value in option.values
    )
    if option.flags[-1] in {"--help", "--version"}:
        excluded = "- *"
    elif option.repeats:
        return " ".join(_single(f"*{flag}[{words}]{values}") for flag in option.flags)
    else:
        excluded = " ".join((*option.flags, *option.excludes))
    return " ".join(_single(f"({excluded}){flag}[{words}]{values}") for flag in option.flags)


def _zsh_positional(argument: Argument) -> str:
    number = "1" if argument.choices else "*"
    return _single(f"{number}:{argument.values[0]}:({' '.join(argument.choices)})")


def fish(top: CommandNode) -> str:
    """The script for fish."""
    lines = []
    for command in top.walk():
        at = " ".join(command.words[1:])
        here = f"-n '__yahboomd_at {at}'" if at else "-n '__yahboomd_ends'"
        for below in command.commands:
            line = f"-d {_fish(below.line)}"
            lines.append(f"-n '__yahboomd_ends {at}' -a {below.words[-1]} {line}")
        for option in command.options:
            flags = " ".join(
                f"-l {flag[2:]}" if flag.startswith("--") else f"-s {flag[1:]}"
                for flag in option.flags
            )
            kind = {
                "nothing": "",
                "file": "-r -F ",
                "folder": "-x -a '(__fish_complete_directories)' ",
                "choice": f"-x -a '{' '.join(option.choices)}' ",
                "value": "-x ",
            }[option.kind]
            lines.append(f"{here} {flags} {kind}-d {_fish(_short(option.help))}")
        choices = " ".join(choice for each in command.positionals for choice in each.choices)
        if choices:
            lines.append(f"-n '__yahboomd_ends {at}' -a '{choices}'")
    return FISH.format(note=NOTE, lines="\n".join(f"complete -c yahboomd {line}" for line in lines))


SCRIPTS: Mapping[str, Callable[[CommandNode], str]] = {"bash": bash, "zsh": zsh, "fish": fish}
"""Makes the script of each shell."""

PLACES: Mapping[str, str] = {
    "bash": "bash-completion/completions/yahboomd",
    "zsh": "zsh/site-functions/_yahboomd",
    "fish": "fish/vendor_completions.d/yahboomd.fish",
}
"""The file in which each shell looks for its script, below a folder ``share``."""


def _short(text: str) -> str:
    """The first clause of a help text."""
    return re.split(r"; |\. | \(", text, maxsplit=1)[0].rstrip(".")


def _single(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


def _fish(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
