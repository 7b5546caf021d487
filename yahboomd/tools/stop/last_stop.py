"""What a guard needs for its last stop: the device again, a look at its wheels, and words.

It opens the device, not its name, which another one may get. The first stop needs only the standard
library; what reads counts is imported after it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import signal
from collections.abc import Callable
from typing import TYPE_CHECKING

from yahboomd.core.link.port_identity import find, identify, is_pseudo
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.seize import Seized, seize

if TYPE_CHECKING:
    from yahboomd.core.link.takeover import TakeoverReport

SAID_WITHIN_S = 0.2


def ignore_signals() -> None:
    """Ignore what ends a service, a session or a job: then a guard is needed most."""
    for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP, signal.SIGCHLD}:
        signal.signal(number, signal.SIG_IGN)


def seize_again(note: PortNote | None) -> Seized:
    """Open the device and send the first stop.

    Raises:
        OSError: It cannot be had now.
    """
    path = "" if note is None else path_of(note)
    if note is None or not path:
        name = "no port" if note is None else note.path
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), name)
    device = identify(os.stat(path))
    return seize(**note._replace(path=path, device=device).options(), patience_s=0.0)


def path_of(note: PortNote) -> str:
    """A path of the device now; empty if it is not there."""
    device = note.device
    found = find(device)
    if found is None and is_pseudo(device.number) and os.path.islink(note.path):
        # A pseudo-terminal does not come back: its owner points the link to the next one.
        with contextlib.suppress(OSError):
            return note.path if is_pseudo(os.stat(note.path).st_rdev) else ""
    return found or ""


def watched(seized: Seized, fd: int, attend: Callable[[], None]) -> TakeoverReport:
    """Stop a board, and watch its wheels for some seconds; the port stays open, and ours.

    Args:
        fd: A descriptor that is not to wait.
        attend: Called while that is readable.
    """
    import asyncio

    from yahboomd.core.clock import SystemClock
    from yahboomd.core.link.takeover import take_over_seized

    async def attended() -> TakeoverReport:
        asyncio.get_running_loop().add_reader(fd, attend)
        shared = seized._replace(fd=os.dup(seized.fd))
        return await take_over_seized(shared, SystemClock())

    return asyncio.run(attended())


def unfinished(note: PortNote, trouble: Exception | TakeoverReport | None) -> str:
    """What keeps a guard from its end, and what a person can do."""
    from yahboomd.core.link.port_errors import explained
    from yahboomd.tools.stop.stop_port import describe
    from yahboomd.tools.stop.unresponsive import true_names

    if isinstance(trouble, OSError):
        words = true_names(explained(path_of(note) or note.path, trouble).message)
    elif isinstance(trouble, Exception):
        words = f"{note.path}: whether the wheels stand cannot be seen ({trouble})."
    else:
        words = describe(trouble) if trouble is not None else ""
    return (
        f"{words} The wheels may turn: switch the motors' supply off, or give the guard the board "
        "back. It stops them as soon as it has the port, and ends once it has seen them stand; "
        f"`kill -9 {os.getpid()}` ends it now."
    )


def prepare() -> None:
    """Import what the rest of this file needs, and what describes a report."""
    import asyncio  # noqa: F401

    import yahboomd.core.link.takeover
    import yahboomd.core.program
    import yahboomd.tools.stop.stop_port
    import yahboomd.tools.stop.unresponsive  # noqa: F401


def say(words: str) -> None:
    """Print a line for a person, without what a terminal may not show."""
    from yahboomd.core.program import pasteable, readable

    write(pasteable(readable(words)))


def write(words: str) -> None:
    """Print a line to standard error, unless its reader is gone or accepts nothing."""
    poll = select.poll()
    poll.register(2, select.POLLOUT)
    try:
        if not poll.poll(1000 * SAID_WITHIN_S):
            return
        os.write(2, f"yahboomd: {words}\n".encode())
    except OSError:
        return
