"""The example programs of ``examples/clients/``: how each is built and started.

A row of ``PROGRAMS`` is a language. Builds go to a cache outside the tree, once for each state of
the sources. A language that cannot be built here is skipped with the name of the missing tool.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "clients"
CACHE = (
    Path(
        os.environ.get("YAHBOOMD_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "yahboomd")
    )
    / "clients"
)

COMMANDS = frozenset(
    {"pose", "status", "estop", "release", "set-pose", "config", "square", "moves", "decode"}
)
Command = list[str]


@dataclass(frozen=True)
class Built:
    """The commands that start a language's two programs.

    Attributes:
        robot: The complete one, after the contract of examples/clients/README.md.
        arc: The short one, which docs/clients.md shows.
        arc_source: Its file.
    """

    robot: Command
    arc: Command
    arc_source: Path


class Missing(Exception):
    """Something that a language needs is not on this machine; the message names it."""


@dataclass(frozen=True)
class Program:
    """A language's example.

    Attributes:
        build: Builds it if necessary; raises :class:`Missing` if it cannot.
        slow: It takes minutes of compiling: its tests are nightly.
        commands: The part of the contract that it can do; docs/clients.md explains the rest.
        gateway: How it reaches the robot through the gateway of web clients: scheme and path.
    """

    build: Callable[[], Built]
    slow: bool = True
    commands: frozenset[str] = COMMANDS
    gateway: str = ""


def needs(program: str, hint: str = "") -> str:
    """The path of a tool."""
    found = shutil.which(program)
    if found is None:
        raise Missing(f"there is no {program} here{f' ({hint})' if hint else ''}")
    return found


def _python(name: str) -> Built:
    folder = EXAMPLES / name
    arc = folder / "arc.py"
    return Built([sys.executable, str(folder / "robot.py")], [sys.executable, str(arc)], arc)


def oldest_python() -> Path:
    """A Python 3.10 with what the client needs: the oldest that it runs on, that of Humble."""
    places = [shutil.which("python3.10"), *Path.home().glob(".pyenv/versions/3.10.*/bin/python")]
    works = [each for each in places if each and not subprocess.call([each, "-c", ""], stderr=-3)]
    if not works:
        raise Missing("there is no python3.10 here")
    folder = CACHE / "python310"
    made, wanted = folder / "made", (ROOT / "pyproject.toml").read_text()
    CACHE.mkdir(parents=True, exist_ok=True)
    # Tests of several processes ask for it at once.
    with (CACHE / "python310.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists() or made.read_text() != wanted:
            _run(works[0], "-m", "venv", "--clear", folder, cwd=ROOT)
            _run(folder / "bin/pip", "install", "-q", ROOT, cwd=ROOT)
            made.write_text(wanted)
    return folder / "bin" / "python"


def _python_310() -> Built:
    """The same programs. What is installed may be older than the tree, which is used."""
    start = ["env", f"PYTHONPATH={ROOT}", str(oldest_python())]
    now = _python("python_client")
    return Built([*start, now.robot[-1]], [*start, now.arc[-1]], now.arc_source)


def _run(*command: str | Path, cwd: Path, environ: dict[str, str] | None = None) -> None:
    """Runs a step of a build, and keeps its output beside its product."""
    log = CACHE / f"{cwd.name}.log"
    with log.open("w") as output:
        done = subprocess.run(
            list(map(str, command)),
            cwd=cwd,
            env={**os.environ, **(environ or {})},
            stdout=output,
            stderr=output,
            check=False,
        )
    if done.returncode != 0:
        errors = [line for line in log.read_text().splitlines() if "error" in line.lower()]
        raise Missing(f"{command[0]} failed: {errors[0] if errors else ''} (all of it: {log})")


def _rust() -> Built:
    cargo = needs("cargo", "https://rustup.rs")
    folder, target = EXAMPLES / "rust", CACHE / "rust"
    _run(cargo, "build", "--locked", cwd=folder, environ={"CARGO_TARGET_DIR": str(target)})
    programs = target / "debug"
    return Built(
        [str(programs / "robot")], [str(programs / "arc")], folder / "src" / "bin" / "arc.rs"
    )


def _c() -> Built:
    cmake, source = needs("cmake"), hashlib.sha256(str(EXAMPLES).encode()).hexdigest()[:8]
    needs("cc")
    # CMake refuses a folder in which it configured another tree.
    target = CACHE / f"c-{source}"
    target.mkdir(exist_ok=True)
    try:
        _run(cmake, EXAMPLES / "c", cwd=target)
    except Missing as missing:
        raise Missing(
            "CMake finds no zenoh-pico (github.com/eclipse-zenoh/zenoh-pico) or no "
            f"jansson (Debian: libjansson-dev): {missing}"
        ) from missing
    _run(cmake, "--build", target, cwd=target)
    return Built([str(target / "robot")], [str(target / "arc")], EXAMPLES / "c" / "arc.c")


def _typescript() -> Built:
    import web_programs

    return web_programs.node_programs()


def _curl() -> Built:
    import web_programs

    return web_programs.curl_programs()


PROGRAMS: dict[str, Program] = {
    "python": Program(partial(_python, "python"), slow=False),
    "python_client": Program(partial(_python, "python_client"), slow=False),
    "python_310": Program(_python_310),
    "rust": Program(_rust),
    "c": Program(_c),
    "typescript": Program(_typescript, gateway="ws:/zenoh"),
    # jq 1.6 has no 64-bit integers, so it decodes no stamps.
    "curl": Program(_curl, gateway="http:/rest", commands=COMMANDS - {"decode"}),
}
