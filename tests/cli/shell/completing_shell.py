"""Shells that complete yahboomd's commands: real ones, on a pseudo-terminal if they need one."""

from __future__ import annotations

import os
import re
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import pytest

PATIENCE_S = 60.0

PRINTED = re.compile(rb"<(\d+)([^<>]*)>")
"""The output of the function in the place of ``yahboomd``: a number, then its arguments."""

FUNCTION = (
    "yahboomd() { number=$((number + 1)); printf '<%s' $number; printf ' %s' \"$@\"; echo '>'; }"
)

BASH = """\
bind 'set completion-query-items -1'; bind 'set page-completions off'
source {script}
"""

ZSH = """\
autoload -Uz compinit; compinit -u -D
zle -C insert-all complete-word _generic; bindkey '\\e*' insert-all
zstyle ':completion:insert-all:*' completer _all_matches _complete
zstyle ':completion:insert-all:*' insert true
source {script}
"""


class Shell(Protocol):
    """A shell with our completions loaded."""

    def complete(self, typed: str) -> list[str]:
        """The offers for the last word of ``typed``, sorted."""
        ...


class TerminalShell:
    """bash or zsh, whose line editors want a terminal.

    The key that inserts every completion at once is typed, then Enter: a function in the place of
    the command prints its arguments.
    """

    def __init__(self, command: list[str], setup: str, folder: Path) -> None:
        self._number = 0
        self._master, slave = os.openpty()
        self._process = subprocess.Popen(
            command,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=folder,
            env={
                "PATH": os.environ["PATH"],
                "TERM": "xterm",
                "HOME": str(folder),
                "COLUMNS": "999",
            },
            start_new_session=True,
        )
        os.close(slave)
        lines = [*setup.splitlines(), FUNCTION, "yahboomd"]
        self._type("".join(f"{line}\n" for line in lines))

    def _type(self, keys: str) -> list[str]:
        """Press keys that end with a line for the function; its arguments."""
        os.write(self._master, keys.encode())
        self._number += 1
        written = b""
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            if select.select([self._master], [], [], 0.1)[0]:
                written += os.read(self._master, 65536)
                for number, words in PRINTED.findall(written):
                    if int(number) == self._number:
                        return words.decode().split()
        raise AssertionError(written.decode(errors="replace"))

    def complete(self, typed: str) -> list[str]:
        *before, _word = typed.removeprefix("yahboomd ").split(" ")
        return sorted(self._type(f"{typed}\x1b*\n")[len(before) :])

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._master)


class Fish:
    """fish, which completes on request."""

    def __init__(self, script: Path, folder: Path) -> None:
        self._script, self._folder = script, folder

    def complete(self, typed: str) -> list[str]:
        done = subprocess.run(
            ["fish", "--no-config", "-c", f"source {self._script}; complete -C '{typed}'"],
            cwd=self._folder,
            env={"PATH": os.environ["PATH"], "HOME": str(self._folder)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr == ""
        return sorted(line.partition("\t")[0] for line in done.stdout.splitlines())


@pytest.fixture(scope="module", params=["bash", "zsh", "fish"])
def shell(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Shell]:
    """A real shell with our script; its folder has a file ``robot.toml`` and a folder ``image``."""
    from yahboomd.cli.shell.command_tree import whole
    from yahboomd.cli.shell.completions import SCRIPTS

    name = request.param
    if shutil.which(name) is None:
        pytest.skip(f"there is no {name} on this machine")
    folder = tmp_path_factory.mktemp(name)
    script = tmp_path_factory.mktemp("script") / "script"
    script.write_text(SCRIPTS[name](whole()))
    (folder / "robot.toml").touch()
    (folder / "image").mkdir()
    if name == "fish":
        yield Fish(script, folder)
        return
    command = ["bash", "--norc", "--noprofile", "-i"] if name == "bash" else ["zsh", "-f", "-i"]
    setup = (BASH if name == "bash" else ZSH).format(script=script)
    running = TerminalShell(command, setup, folder)
    yield running
    running.close()
