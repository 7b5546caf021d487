"""``yahboomd completions``: what lets a shell complete commands and options."""

from __future__ import annotations

import argparse
import os

DESCRIPTION = """\
Print a script that lets a shell complete the commands and options of yahboomd. The Debian package
and `yahboomd install` put these scripts in place; where yahboomd is installed otherwise, load one.
"""

EPILOG = """\
examples:
  source <(yahboomd completions bash)                 in ~/.bashrc
  source <(yahboomd completions zsh)                  in ~/.zshrc, below compinit
  yahboomd completions fish > ~/.config/fish/completions/yahboomd.fish

exit status:
  0    the script was printed
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        "completions",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "shell", metavar="SHELL", choices=("bash", "zsh", "fish"), help="bash, zsh or fish"
    )


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    from yahboomd.cli.shell.command_tree import whole
    from yahboomd.cli.shell.completion_scripts import SCRIPTS

    print(SCRIPTS[args.shell](whole()), end="")
    return os.EX_OK
