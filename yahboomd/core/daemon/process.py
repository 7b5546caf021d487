"""The daemon's process: its signals, its service manager, its start.

The default action of almost every signal ends or suspends a process at once, and the board
drives on: so the wheels are stopped first. SIGKILL and SIGSTOP cannot be caught, and after a fault
of the program (SIGSEGV, SIGABRT) no code of it can be relied on: there its guard stops the wheels.

systemd receives datagrams on the socket that ``NOTIFY_SOCKET`` names (sd_notify(3)).
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import os
import re
import signal
import socket
from collections.abc import Awaitable, Callable, Mapping

from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.daemon.logs import flush
from yahboomd.core.errors import BusError, ConfigError
from yahboomd.core.model import NS_PER_S

log = logging.getLogger(__name__)

ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
"""The signals that ask for an orderly end: status 0."""

SUSPENDING = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
"""The signals that suspend a terminal's programs."""

BACK_OFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)
"""Waits between attempts; the last one repeats."""

PATIENCE_S = 60.0
"""The time that one start waits. A process that waits for the start to end (``systemctl start``, an
installation, the machine's boot) is not held for ever; the service manager starts another one."""

_FAULTS = {"ABRT", "BUS", "FPE", "ILL", "SEGV"}
_HARMLESS = {"CHLD", "CONT", "URG", "WINCH"}
_NOT_CAUGHT = {"KILL", "STOP"}


def _others() -> list[int]:
    names = _FAULTS | _HARMLESS | _NOT_CAUGHT
    left_out = {getattr(signal, f"SIG{name}") for name in names} | {*ENDING, *SUSPENDING}
    return sorted(signal.valid_signals() - left_out)


KILLING = _others()
"""Every other signal whose default action ends the process: it ends after the wheels stop."""


def deadly() -> list[int]:
    """Every signal that would end this process, daemon or command; an ignored one stays ignored."""
    return [*ENDING, *(each for each in KILLING if signal.getsignal(each) is signal.SIG_DFL)]


def name_of(number: int) -> str:
    """``SIGQUIT``; ``SIGRTMIN+1`` for those without a name of their own."""
    with contextlib.suppress(ValueError):
        return signal.Signals(number).name
    return f"SIGRTMIN+{number - signal.SIGRTMIN}"


class Signals:
    """Handlers of every signal that would end or suspend the process.

    Args:
        end: Called with the name of a signal that asks for the end.

    Attributes:
        suspend: Set while the process is to be suspended; the wheels have to stand first.
        fatal: The signal that the process is to die of, once the wheels stand; None for none.
        at_once: Nothing moves yet: a suspension need not wait for the wheels.
    """

    def __init__(self, end: Callable[[str], None]) -> None:
        self._end = end
        self._installed: list[int] = []
        self._asked = False
        self.suspend = asyncio.Event()
        self.fatal: int | None = None
        self.at_once = True

    def install(self) -> None:
        loop = asyncio.get_running_loop()
        self._installed = [*deadly(), signal.SIGCONT]
        for number in self._installed:
            loop.add_signal_handler(number, self._ends, number)
        loop.add_signal_handler(signal.SIGCONT, self._continued)
        self._await_suspension()
        # A terminal repeats SIGTTOU as often as something writes: one byte for each is too many.
        signal.set_wakeup_fd(signal.set_wakeup_fd(-1), warn_on_full_buffer=False)

    def remove(self) -> None:
        """Remove the handlers. If the end was asked for, asking again changes nothing."""
        loop = asyncio.get_running_loop()
        for number in (*self._installed, *SUSPENDING):
            loop.remove_signal_handler(number)
            if self._asked and number in ENDING:
                signal.signal(number, signal.SIG_IGN)

    def freeze(self) -> None:
        """Suspend the process; returns when it continues."""
        log.info("Suspended. SIGCONT (fg, bg) continues it.")
        # A thread writes the log, and is suspended with the rest.
        flush()
        os.kill(os.getpid(), signal.SIGSTOP)
        self.resume()
        log.info("Continued.")

    def resume(self) -> None:
        self.suspend.clear()
        self._await_suspension()

    def _await_suspension(self) -> None:
        loop = asyncio.get_running_loop()
        for number in SUSPENDING:
            loop.add_signal_handler(number, self._suspends, number)

    def _ends(self, number: int) -> None:
        if number in ENDING:
            self._asked = True
        elif self.fatal is None:
            self.fatal = number
        self._end(name_of(number))

    def _suspends(self, number: int) -> None:
        # Until that is done a background process may write to its terminal, which would send the
        # same signal each time.
        for each in SUSPENDING:
            signal.signal(each, signal.SIG_IGN)
        if self.at_once:
            self.freeze()
        elif not self.suspend.is_set():
            log.info("%s: stopping the wheels, then suspending.", name_of(number))
            self.suspend.set()

    def _continued(self) -> None:
        if self.suspend.is_set():
            # It continued before the wheels stood: the shell believes that it runs already.
            self.resume()


def die_of(number: int) -> None:
    """End this process by the default action of a signal; returns if that is blocked."""
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


_AGE = re.compile(r" \(since [^)]*\)| [\d.]+ s ago")


def without_age(words: str) -> str:
    """The words of a status without the ages in them."""
    return _AGE.sub("", words)


class Notifier:
    """Reports to the service manager, if there is one."""

    def __init__(self, environ: Mapping[str, str]) -> None:
        address = environ.get("NOTIFY_SOCKET", "")
        # An abstract socket is written with @ and addressed with a NUL.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        self._status = ""
        self.watchdog_ns = _watchdog_ns(environ)
        if address:
            self._socket = socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
            )

    @property
    def heard(self) -> bool:
        return self._socket is not None

    def ready(self) -> None:
        self._send("READY=1")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def status(self, words: str) -> None:
        """Report the state in words; the same words are not sent again.

        Nor are words that differ in an age alone: each would wake the manager and its listeners,
        twice a second.
        """
        words = without_age(words.replace("\n", " "))
        if words != self._status:
            self._status = words
            self._send(f"STATUS={words}")

    def alive(self) -> None:
        self._send("WATCHDOG=1")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            # A manager that is too busy to listen must not stop a robot's control loop.
            with contextlib.suppress(OSError):
                self._socket.sendto(message.encode(), self._address)


def _watchdog_ns(environ: Mapping[str, str]) -> int | None:
    """The period at which the watchdog wants to be fed; ``None`` without a watchdog."""
    try:
        interval_us = int(environ.get("WATCHDOG_USEC", ""))
        owner = int(environ.get("WATCHDOG_PID", str(os.getpid())))
    except ValueError:
        return None
    if interval_us <= 0 or owner != os.getpid():
        return None
    return interval_us * (NS_PER_S // 1_000_000)


async def open_bus(
    open_once: Callable[[], Awaitable[None]],
    *,
    notifier: Notifier,
    clock: Clock,
    stop: asyncio.Event,
) -> bool:
    """Open the bus; under a service manager, try again until it opens.

    Without a manager the first failure is raised, for a person to read. Under one, a
    service that ended for it would be started again every second, for ever: another process has the
    port to listen on, the network has not given out an address yet, a folder is not mounted.

    Args:
        open_once: Opens it, or raises a BusError.
        notifier: Reports the reason of the wait to the manager.
        stop: Set when the daemon is to end.

    Returns:
        Whether it is open; it is not if ``stop`` was set meanwhile.

    Raises:
        BusError: It cannot be opened as configured, or could not within :data:`PATIENCE_S`.
    """
    until_ns = clock.now_ns() + nanoseconds(PATIENCE_S)
    said = ""
    for attempt in itertools.count():
        try:
            await open_once()
        except BusError as error:
            if isinstance(error, ConfigError) or not notifier.heard or clock.now_ns() >= until_ns:
                raise
            notifier.status(f"waiting for the bus: {error}")
            if error.message != said:
                said = error.message
                log.warning("%s yahboomd keeps trying.", error)
        else:
            return True
        try:
            async with asyncio.timeout(BACK_OFF_S[min(attempt, len(BACK_OFF_S) - 1)]):
                await stop.wait()
        except TimeoutError:
            continue
        return False
    raise AssertionError  # the count has no end
