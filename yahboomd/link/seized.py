"""A seized port on an event loop: what :mod:`~yahboomd.link.seize` opened, as a ``Port``.

The daemon's own port is pyserial-asyncio's. This one goes without, because its descriptor was
opened before pyserial was imported, and opening it again could reset the board.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import os
import termios
from collections.abc import Callable

from yahboomd.clock import Clock
from yahboomd.link.draining import drained, drop, in_kernel
from yahboomd.link.port import MAX_PENDING, byte_time_ns
from yahboomd.link.seize import Seized

READ_BYTES = 4096


class SeizedPort:
    """A descriptor as the ``Port`` that conversations and stops write on.

    Args:
        seized: The descriptor, which is this object's to close from now on.
        clock: What tells the time.
    """

    def __init__(self, seized: Seized, clock: Clock) -> None:
        self._fd = seized.fd
        self._clock = clock
        self._loop: asyncio.AbstractEventLoop | None = None
        self._on_data: Callable[[bytes], None] = lambda _data: None
        self._on_lost: Callable[[Exception | None], None] = lambda _error: None
        self._waiting = bytearray()
        self._open = True
        self.name = seized.path
        self.byte_ns = byte_time_ns(seized.baudrate)

    @property
    def pending(self) -> int:
        """Bytes that the kernel did not take yet."""
        return len(self._waiting)

    def listen(
        self, on_data: Callable[[bytes], None], on_lost: Callable[[Exception | None], None]
    ) -> None:
        """Tell who hears bytes and the loss of the port; on the running loop from now on."""
        self._on_data = on_data
        self._on_lost = on_lost
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._fd, self._read)

    def write(self, data: bytes) -> None:
        """Send; never blocks and never raises: a lost port is reported to ``on_lost``."""
        if not self._open:
            return
        if len(self._waiting) > MAX_PENDING:
            self._lose(OSError(errno.ETIMEDOUT, "the port takes no output"))
            return
        self._waiting += data
        self._flush()

    def gather(self, least: int) -> None:
        """Nothing: what is said here is short, and no stream."""

    def look(self) -> None:
        """Nothing: no byte is kept."""

    @property
    def queued(self) -> int:
        """Bytes that are not on the wire yet, as far as the system knows."""
        return self.pending + in_kernel(self._fd) if self._open else 0

    def discard(self) -> None:
        """Drop them, where the driver can: it may cut a frame in half."""
        if self._open:
            self._waiting.clear()
            drop(self._fd)

    async def drain(self, timeout_s: float) -> bool:
        """Wait until everything is on the wire; whether it is."""

        def waiting() -> int | None:
            return self.queued if self._open else None

        return await drained(self._clock, waiting, byte_ns=self.byte_ns, timeout_s=timeout_s)

    def close(self) -> None:
        """Let go at once; what is not on the wire is discarded."""
        if not self._open:
            return
        self._open = False
        if self._loop is not None:
            self._loop.remove_reader(self._fd)
            self._loop.remove_writer(self._fd)
        # Closing would wait for output that the device does not read.
        drop(self._fd)
        with contextlib.suppress(OSError):
            fcntl.ioctl(self._fd, termios.TIOCNXCL)
        os.close(self._fd)

    def _read(self) -> None:
        try:
            data = os.read(self._fd, READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._lose(error)
            return
        if data:
            self._on_data(data)
        else:
            self._lose(None)

    def _flush(self) -> None:
        try:
            taken = os.write(self._fd, self._waiting)
        except BlockingIOError:
            taken = 0
        except OSError as error:
            self._lose(error)
            return
        del self._waiting[:taken]
        if self._loop is not None:
            if self._waiting:
                self._loop.add_writer(self._fd, self._flush)
            else:
                self._loop.remove_writer(self._fd)

    def _lose(self, why: Exception | None) -> None:
        if self._open:
            self.close()
            self._on_lost(why)
