"""Messages to systemd: ready, alive, and in words what the daemon is waiting for.

The protocol is a datagram on the socket that ``NOTIFY_SOCKET`` names (sd_notify(3)). Without one
nothing is sent.
"""

from __future__ import annotations

import contextlib
import os
import re
import socket
from collections.abc import Mapping

from yahboomd.clock import NS_PER_S

_AGE = re.compile(r" \(since [^)]*\)| [\d.]+ s ago")


class Notifier:
    """Talks to the service manager, where there is one.

    Args:
        environ: The process's environment.
    """

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
        """Whether there is a manager."""
        return self._socket is not None

    def ready(self) -> None:
        """Configuration and bus stand."""
        self._send("READY=1")

    def stopping(self) -> None:
        """The end has begun."""
        self._send("STOPPING=1")

    def status(self, words: str) -> None:
        """Say in words what is going on; the same words again are not sent.

        Nor are words that differ in an age alone: each would wake the manager and its listeners,
        twice a second.
        """
        words = _AGE.sub("", words)
        if words != self._status:
            self._status = words
            self._send(f"STATUS={words}")

    def alive(self) -> None:
        """Feed the watchdog."""
        self._send("WATCHDOG=1")

    def close(self) -> None:
        """Let go of the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            # A manager that is too busy to listen must not stop a robot's control loop.
            with contextlib.suppress(OSError):
                self._socket.sendto(message.encode(), self._address)


def _watchdog_ns(environ: Mapping[str, str]) -> int | None:
    """How often the watchdog wants to be fed; ``None`` without a watchdog."""
    try:
        interval_us = int(environ.get("WATCHDOG_USEC", ""))
        owner = int(environ.get("WATCHDOG_PID", str(os.getpid())))
    except ValueError:
        return None
    if interval_us <= 0 or owner != os.getpid():
        return None
    return interval_us * (NS_PER_S // 1_000_000)
