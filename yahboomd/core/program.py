"""Texts for a person's terminal: commands that can be pasted, and no control characters.

Texts name `yahboomd stop`; in a virtual environment that is not active, the shell knows only
`.venv/bin/yahboomd`. :func:`pasteable` replaces one by the other.
"""

from __future__ import annotations

import os
import re
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

COMMANDS = {
    "run": "drive the board: the daemon itself",
    "simulate": "be a board on a pseudo-terminal, with a robot behind it",
    "stop": "stop the wheels, through the daemon or on the port itself",
    "monitor": "watch a running daemon: pose, wheels, battery, who drives",
    "drive": "drive the robot with the keyboard",
    "status": "print a daemon's state, and whether it can drive",
    "pose": "print the robot's pose, or set it",
    "send": "drive for a number of seconds",
    "move": "drive straight, turn, go to a place, follow a path",
    "moves": "serve moves to their goals, for `yahboomd move` and programs",
    "call": "call a service of the daemon",
    "events": "print events as they happen",
    "record": "write the messages of the bus to MCAP files",
    "replay": "compute the poses of a black box again",
    "web": "serve the page that drives the robot from a phone",
    "blackbox": "explain why the robot stopped, by its last minute",
    "metrics": "serve the daemon's counters, for Prometheus and Grafana",
    "probe": "find the port, name the board, explain problems",
    "setup": "find out how the motors are connected, and write robot.toml",
    "calibrate": "find the true size of the wheels and the track",
    "tune": "measure how the wheels follow, and find better gains",
    "config": "check, show and explain the configuration",
    "report": "write one file for somebody who helps with a problem",
    "install": "install the service: at boot, or as the board is plugged in",
    "uninstall": "take the service away again",
    "completions": "print what completes commands in bash, zsh or fish",
}
"""Every subcommand with its line in the help."""

PACKAGES = ("fleet",)
"""Subcommands that other packages bring: yahboomd-fleet, which is `extras/fleet` of the source."""

STANDARD_LISTEN = "tcp/127.0.0.1:7448"
"""The endpoint on which a daemon listens by default; commands connect to it."""

STANDARD_PATH = Path("/etc/yahboomd/config.toml")
"""The configuration that is read if no file is named, and it exists."""

_PASTED = re.compile(rf"(?<![\w/.-])yahboomd (?=(?:{'|'.join((*COMMANDS, *PACKAGES))})\b)")


def readable(text: str) -> str:
    """The text without control characters, except line ends and tabs.

    Boards, other clients of the bus and file names contribute to printed and logged texts.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else "?" for c in text)


def plain(text: str) -> str:
    """Text without control characters: a message of the bus must not command a terminal."""
    return text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)


def name() -> str:
    """The word that starts this program from a shell in the current folder."""
    own = Path(sys.executable).with_name("yahboomd")
    if not own.exists():
        return "yahboomd"
    for folder in os.environ.get("PATH", "").split(os.pathsep):
        found = Path(folder or ".", "yahboomd")
        if os.access(found, os.X_OK):
            # A package may have put a link on the PATH.
            if found.samefile(own):
                return "yahboomd"
            break
    return str(_from_here(own))


def _from_here(path: Path) -> Path:
    try:
        here = Path.cwd()
    except OSError:
        # The folder was removed while the program runs.
        return path
    # A service's folder is the root.
    is_below = path.is_relative_to(here) and here != Path("/")
    return path.relative_to(here) if is_below else path


def pasteable(text: str) -> str:
    if _PASTED.search(text) is None or (called := name()) == "yahboomd":
        return text
    return _PASTED.sub(lambda _found: f"{called} ", text)


def install_command(extra: str) -> str:
    """The command that installs an extra of yahboomd, or one of ``PACKAGES``."""
    source = Path(__file__).parents[2]
    package = f"yahboomd-{extra}" if extra in PACKAGES else f"yahboomd[{extra}]"
    if (source / "pyproject.toml").is_file():
        place = "." if _from_here(source) == Path() else str(source)
        package = place + (f"/extras/{extra}" if extra in PACKAGES else f"[{extra}]")
    return shlex.join([str(_from_here(Path(sys.executable))), "-m", "pip", "install", package])


def release_command(namespace: str, listen: Sequence[str]) -> str:
    """The command that releases the emergency stop of this daemon, and of no other."""
    words = ["yahboomd stop --release"]
    words += [f"--namespace {namespace}"] if namespace else []
    if listen and STANDARD_LISTEN not in listen:
        local = listen[0].replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
        words.append(f"--connect {shlex.quote(local)}")
    return " ".join(words)
