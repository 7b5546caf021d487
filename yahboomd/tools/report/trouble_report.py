"""Writes one file for somebody who helps: the output of the commands that a person would run."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path

from yahboomd import __version__
from yahboomd.core.program import readable

PATIENCE_S = 30.0
"""For one command: one that hangs is a fact of the report, and does not end it."""

LIBRARIES = ("eclipse-zenoh", "msgspec", "pydantic", "pyserial", "pyserial-asyncio")
PORTS = ("ttyUSB*", "ttyACM*", "ttyTHS*", "ttyAMA*", "serial/by-id/*", "myserial", "yahboom*")

QUESTIONS = {
    "config-check": ("config", "check"),
    "config": ("config", "show", "--origin"),
    "status": ("status",),
    "status-json": ("status", "--json"),
    "probe": ("probe",),
    "blackboxes": ("blackbox", "list"),
    "blackbox-explained": ("blackbox", "explain"),
}
"""The commands that are asked, by the name of their part. None of them turns a wheel or writes."""

JOURNAL = (
    *("journalctl", "--no-pager", "--lines", "400", "--output", "short-precise"),
    *("--unit", "yahboomd.service", "--unit", "yahboomd@*"),
)
"""The daemons' words. Those of the page are left out: they name links that let people in."""


def write_report(
    path: Path,
    options: Callable[[str], Sequence[str]],
    box: tuple[str, bytes] | None,
    said: Callable[[str], None],
) -> None:
    """Write the report.

    Args:
        path: The ZIP file to write; it must not exist.
        options: The options that name the robot, for a command.
        box: Name and bytes of the newest black box; None if there is none.
        said: Is told what is done next.

    Raises:
        OSError: The file cannot be written.
    """
    # It has a robot's last minute and this machine's folders: the person who asked passes it on.
    made = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb")
    if os.geteuid() == 0 and (owner := os.environ.get("SUDO_UID", "")).isdecimal():
        os.fchown(made.fileno(), int(owner), -1)
    with made, zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("machine.txt", "\n".join(_machine()) + "\n")
        for part, words in QUESTIONS.items():
            said(f"yahboomd {' '.join(words)}")
            command = [sys.executable, "-m", "yahboomd", *words, *options(words[0])]
            file.writestr(f"{part}.txt", _printed(command, f"yahboomd {' '.join(words)}"))
        said(" ".join(JOURNAL[:1]))
        file.writestr("journal.txt", _printed(JOURNAL, " ".join(JOURNAL)))
        if box is not None:
            file.writestr(*box)


def _printed(command: Sequence[str], shown: str) -> str:
    """What a command prints, with its exit status."""
    try:
        done = subprocess.run(  # noqa: S603 - our own, and journalctl
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=PATIENCE_S,
            check=False,
        )
    except subprocess.TimeoutExpired as hung:
        ended, output = f"did not end within {PATIENCE_S:.0f} s", hung.stdout or b""
    except OSError as error:
        ended, output = f"could not be started: {error.strerror}", b""
    else:
        ended, output = f"exit status {done.returncode}", done.stdout
    return f"$ {shown}\n{readable(output.decode(errors='replace'))}\n({ended})\n"


def _machine() -> Iterator[str]:
    yield f"yahboomd {__version__}"
    yield f"Python {platform.python_version()}"
    for name in LIBRARIES:
        yield f"{name} {metadata.version(name)}"
    yield f"{platform.system()} {platform.release()}, {platform.machine()}, {os.cpu_count()} cores"
    yield from _first_line("/etc/os-release", lambda line: line.startswith("PRETTY_NAME"))
    yield from _first_line("/proc/device-tree/model")
    yield from _first_line("/proc/meminfo")
    yield from _first_line("/proc/loadavg")
    yield f"user {os.geteuid()}, groups {sorted(os.getgroups())}"
    for pattern in PORTS:
        for port in sorted(Path("/dev").glob(pattern)):
            yield _port(port)


def _first_line(path: str, wanted: Callable[[str], bool] = bool) -> Iterable[str]:
    try:
        lines = Path(path).read_text(errors="replace").replace("\0", "").splitlines()
    except OSError:
        return []
    return [readable(line) for line in lines if wanted(line)][:1]


def _port(port: Path) -> str:
    try:
        mode = f"{port.stat().st_mode & 0o777:o} of group {port.stat().st_gid}"
    except OSError as error:
        mode = str(error.strerror)
    return f"{port} -> {os.path.realpath(port)}, {mode}"
