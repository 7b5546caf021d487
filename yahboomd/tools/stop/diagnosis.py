"""Explains the error of a port with facts from this machine."""

from __future__ import annotations

import getpass
import grp
import os
import stat
from collections.abc import Iterable
from pathlib import Path

from yahboomd.core.errors import LinkError, PortBusy, PortDenied, PortMissing
from yahboomd.core.link.discovery import Candidate, without_driver
from yahboomd.core.link.line import ReceivedSample
from yahboomd.core.link.port_errors import holders
from yahboomd.core.protocol.registry import DIALECTS, unknown_dialect

KNOWN_HOLDERS = {
    "brltty": "brltty takes CH340 devices for braille displays: sudo apt remove brltty, then plug "
    "the board in again.",
    "ModemManager": "ModemManager tries new serial ports for modems: wait some seconds, or "
    "sudo systemctl disable --now ModemManager.",
    **dict.fromkeys(
        ("yahboomd setup", "yahboomd tune"),
        "It turns wheels: `yahboomd stop` ends it, and sees them stand.",
    ),
    "yahboomd's guard": "The guard stops the wheels that a killed daemon, setup or tune left "
    "turning, and ends once it has seen them stand. Is the board on?",
    "yahboomd": "A yahboomd daemon owns the board: `yahboomd monitor` watches it, and "
    "`yahboomd stop` stops its wheels. To use the port itself, end the daemon first.",
}
"""Programs that are known to hold such ports, each with advice."""

MOSTLY_TEXT = 0.9
"""A larger share of printable bytes is another device's text; a smaller one is noise."""


def hints(
    error: LinkError,
    path: str,
    *,
    found: Iterable[Candidate] = (),
    sysfs: Path = Path("/sys/bus/usb/devices"),
) -> tuple[str, ...]:
    """Further facts about an error, the most likely cause first.

    Args:
        path: The wanted port; empty if none was found.
    """
    if isinstance(error, PortMissing):
        return _missing(str(error), path, found, sysfs)
    if isinstance(error, PortDenied):
        return _denied(path)
    if isinstance(error, PortBusy):
        return busy(holders(path))
    if type(error) is LinkError:
        return ("Is the path right? `yahboomd probe --list` names the serial ports.",)
    return ()


def _missing(said: str, path: str, found: Iterable[Candidate], sysfs: Path) -> tuple[str, ...]:
    words = []
    hint = without_driver(sysfs)
    if hint and hint not in said:
        words.append(hint)
    if path and os.path.islink(path):
        words.append(f"{path} is a link to {os.readlink(path)}, which is not there.")
    others = ", ".join(each.path for each in found)
    if path and others:
        words.append(f"Serial ports that are there: {others}.")
    elif path and not words:
        words.append(
            "No serial port is on USB at all: is the board plugged in, with a cable that carries "
            "data? `sudo dmesg | tail` shows what the kernel saw."
        )
    return tuple(words)


def _denied(path: str) -> tuple[str, ...]:
    try:
        status = os.stat(path)
        group = grp.getgrgid(status.st_gid)
    except (OSError, KeyError):
        return ()
    words = f"{path} belongs to the group {group.gr_name}"
    if not status.st_mode & stat.S_IWGRP:
        return (f"{words}, which may not write to it either: a udev rule may set its mode.",)
    user = getpass.getuser()
    if status.st_gid in {os.getegid(), *os.getgroups()}:
        return (f"{words}, and {user} is in it: something else forbids it (a container?).",)
    if user in group.gr_mem:
        return (f"{words}; {user} is in it, but not since this login: log out and in again.",)
    return (f"{words}; {user} is not in it: sudo usermod -aG {group.gr_name} {user}.",)


def busy(who: tuple[str, ...]) -> tuple[str, ...]:
    """Advice about the holders of a port.

    Args:
        who: From :func:`yahboomd.core.link.port_errors.holders`.
    """
    if not who:
        return ("By a process that this user may not see: sudo fuser -v PORT names it.",)
    names = dict.fromkeys(each.partition(" (")[0] for each in who)
    return tuple(KNOWN_HOLDERS[name] for name in names if name in KNOWN_HOLDERS)


def what_was_heard(heard: ReceivedSample, readers: str = "") -> str:
    """Describe the bytes of a port without a board, and their likely cause.

    Args:
        readers: Who else has the port open, as a sentence.
    """
    data = heard.start
    if words := unknown_dialect(data) or readers:
        return words
    if not data:
        return (
            "No byte came. Is the board's own switch on, and its supply connected? Another "
            "device may be behind this port; and RTS asserted at a reset leaves the board silent: "
            "press its reset button."
        )
    count = heard.counters.bytes
    printable = sum(32 <= byte < 127 or byte in b"\t\r\n" for byte in data) / len(data)
    if printable >= MOSTLY_TEXT:
        text = data.decode("ascii", "replace").split("\n")[0].strip() or "empty lines"
        return (
            f"{count} bytes of text came, but no board's ({_short(text)!r}): another device "
            "is behind this port."
        )
    rates = " or ".join(str(rate) for rate in sorted({d.baudrate for d in DIALECTS.values()}))
    return (
        f"{count} bytes came and most are no text ({data[:8].hex(' ')} ...): another baud rate "
        f"than the board's {rates}, another device, or a bad cable."
    )


def _short(text: str, limit: int = 40) -> str:
    return text if len(text) <= limit else f"{text[: limit - 3]}..."
