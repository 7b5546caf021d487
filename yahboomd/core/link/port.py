"""The serial port: opened once, owned alone, never blocking.

:mod:`~yahboomd.core.link.seize` opens it, for the daemon and for a process that stops wheels before
it imports anything. pyserial configures it, and pyserial-asyncio carries the bytes. Three of its
habits do not fit a program that stops wheels, and are corrected here:

- its ``write`` waits for the loop to report the port writable; here a frame that finds the port
  free is written at once, and the buffer takes only the bytes that the kernel did not;
- its close calls ``tcdrain`` on the loop's thread, and the kernel waits again for output that
  is not read: both are cut short by discarding the output first, so this file drains itself, with
  a deadline (:meth:`SerialPort.drain`);
- a read that fails while output is waiting makes it wait for the output first; if the device
  takes nothing, ``connection_lost`` never comes: reading errors are reported from the serial
  object itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import os
import termios
from collections.abc import Awaitable, Callable
from typing import Protocol

import msgspec
import serial
import serial_asyncio

from yahboomd.core.clock import Clock
from yahboomd.core.link.draining import drained, drop, in_kernel
from yahboomd.core.link.port_errors import explained, lost
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.seize import Seized, take
from yahboomd.core.model import NS_PER_S

BITS_PER_BYTE = 10  # 8N1: a start bit, eight of data, a stop bit

MAX_PENDING = 4096
"""Bytes of output that the kernel did not take; beyond that the port counts as stuck."""


def byte_time_ns(baudrate: int) -> int:
    """The time of one byte on the wire (86.8 us at 115200)."""
    return BITS_PER_BYTE * NS_PER_S // baudrate


class PortOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options for opening a port.

    Attributes:
        path: The device, such as ``/dev/yahboom_driver``.
        dtr: State of DTR, set before the port opens (the board wires it to its reset).
        rts: State of RTS, likewise (wired to the boot selection).
        hangup_on_close: Leave HUPCL set: closing drops DTR, which may reset the board.
        relay: The line of the relay in the motors' supply; empty for none.
    """

    path: str
    baudrate: int = 115200
    dtr: bool = True
    rts: bool = False
    hangup_on_close: bool = False
    relay: str = ""


class Port(Protocol):
    """The interface of a port; the simulated one in memory has it too."""

    @property
    def name(self) -> str:
        """Its name in messages."""

    @property
    def byte_ns(self) -> int:
        """Nanoseconds that a byte takes on the wire."""

    def queued(self) -> int:
        """Bytes written here and not on the wire yet, as far as the system knows."""

    def listen(
        self, on_data: Callable[[bytes], None], on_lost: Callable[[Exception | None], None]
    ) -> None:
        """Set the receivers of bytes and of the loss of the port."""

    def write(self, data: bytes) -> None:
        """Send; never blocks and never raises: a lost port is reported to ``on_lost``."""

    def drop_input(self) -> None:
        """Drop the bytes that came and were not read yet."""

    def discard(self) -> None:
        """Drop output that is not on the wire, if the driver can: it may cut a frame in half."""

    async def drain(self, timeout_s: float) -> bool:
        """Wait until everything is on the wire; return whether it is."""

    def close(self) -> None:
        """Close at once; output that is not on the wire is discarded."""


Opener = Callable[[], Awaitable[Port]]


class _Serial(serial.Serial):
    """A port that is open already, adapted to an event loop.

    Args:
        fd: The descriptor, which this object closes.
    """

    fd: int | None = None
    on_broken: Callable[[Exception | None], None]

    def __init__(self, fd: int, baudrate: int) -> None:
        # With an inter-byte timeout a read brings a byte at least, or nothing from a port that
        # hung up.
        super().__init__(baudrate=baudrate, timeout=0, write_timeout=0, inter_byte_timeout=0)
        self.fd, self.is_open = fd, True

    def configure(self, *, hangup_on_close: bool) -> None:
        """Make it raw, discard its input, and set whether closing drops DTR."""
        self._reconfigure_port(force_update=True)  # type: ignore[attr-defined]
        self.reset_input_buffer()
        attributes = termios.tcgetattr(self.fileno())
        attributes[2] = (attributes[2] & ~termios.HUPCL) | (termios.HUPCL if hangup_on_close else 0)
        termios.tcsetattr(self.fileno(), termios.TCSANOW, attributes)

    def read(self, size: int = 1) -> bytes:
        try:
            data = os.read(self.fd, size)  # type: ignore[arg-type]
        except BlockingIOError:
            return b""
        except OSError as error:
            self.on_broken(error)
            raise serial.SerialException(str(error)) from error
        if not data:
            self.on_broken(None)
            raise serial.SerialException("the port hung up")
        return data

    def write(self, data: bytes) -> int:  # type: ignore[override]
        try:
            return os.write(self.fileno(), data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise serial.SerialException(str(error)) from error

    def flush(self) -> None:
        """Do nothing: ``tcdrain`` would block the loop. See ``SerialPort.drain``."""

    def close(self) -> None:
        fd, self.fd, self.is_open = self.fd, None, False
        if fd is not None:
            # Closing would wait for output that the device does not read.
            drop(fd)
            with contextlib.suppress(OSError):
                fcntl.ioctl(fd, termios.TIOCNXCL)
            os.close(fd)


class SerialPort(asyncio.Protocol):
    """A real port (a pty counts as one). Made by :func:`open_port` and :func:`adopt`.

    Attributes:
        guard: The guard that shares it.
    """

    def __init__(self, device: _Serial, path: str, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self._transport: serial_asyncio.SerialTransport | None = None
        self._on_data: Callable[[bytes], None] = lambda _data: None
        self._on_lost: Callable[[Exception | None], None] = lambda _error: None
        self._lost = False
        self._spilled = False
        self.guard: PortGuard | None = None
        self._fd: int = device.fileno()
        self.name = path
        self.byte_ns = byte_time_ns(device.baudrate)
        device.on_broken = self._broken

    # For asyncio.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        self._on_data(data)

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        self._report(exc)

    # For the session.

    def listen(
        self, on_data: Callable[[bytes], None], on_lost: Callable[[Exception | None], None]
    ) -> None:
        self._on_data = on_data
        self._on_lost = on_lost

    def share(self, guard: PortGuard, options: PortOptions) -> PortNote:
        """Share this port with a guard until it is closed; returns what it is told of the port.

        Args:
            options: How it was opened.
        """
        device = identify(os.fstat(self._fd))
        note = PortNote(**msgspec.structs.asdict(options), device=device, pid=os.getpid())
        self.guard = guard
        guard.share(self, note)
        return note

    def fileno(self) -> int:
        return self._fd

    @property
    def pending(self) -> int:
        """Bytes that the kernel did not take yet."""
        if not self._spilled or self._transport is None or self._lost:
            return 0
        size: int = self._transport.get_write_buffer_size()
        self._spilled = size > 0
        return size

    def queued(self) -> int:
        if self._lost:
            return 0
        return in_kernel(self._fd) + (self.pending if self._spilled else 0)

    def drop_input(self) -> None:
        # The event loop learns of a lost port by itself.
        if not self._lost:
            with contextlib.suppress(termios.error):
                termios.tcflush(self._fd, termios.TCIFLUSH)

    def discard(self) -> None:
        if not self._lost and self._transport is not None:
            self._transport.flush()
            drop(self._fd)

    def write(self, data: bytes) -> None:
        if self._lost or self._transport is None:
            return
        pending = self.pending
        if pending == 0:
            try:
                taken = os.write(self._fd, data)
            except BlockingIOError:
                taken = 0
            except OSError as error:
                self._broken(error)
                return
            if taken == len(data):
                return
            data = data[taken:]
            self._spilled = True
        elif pending > MAX_PENDING:
            self._broken(OSError(errno.ETIMEDOUT, "the port takes no output"))
            return
        self._transport.write(data)

    async def drain(self, timeout_s: float) -> bool:
        def waiting() -> int | None:
            return None if self._lost else self.queued()

        return await drained(self._clock, waiting, byte_ns=self.byte_ns, timeout_s=timeout_s)

    def close(self) -> None:
        self._on_data = lambda _data: None
        self._on_lost = lambda _error: None
        self._lost = True
        self._abort()
        if self.guard is not None:
            self.guard.close_port()
        # The transport would do it in the loop's next iteration: a process that opens the port at
        # once must not find it held by us.
        self._device.close()

    def _broken(self, error: Exception | None) -> None:
        self._report(error)
        # Not at once: the transport may be detecting the same error just now.
        asyncio.get_running_loop().call_soon(self._abort)

    def _abort(self) -> None:
        transport, self._transport = self._transport, None
        if transport is None or (transport.is_closing() and not transport.get_write_buffer_size()):
            # It ends by itself; aborted as well, it would end twice.
            return
        transport.abort()

    def _report(self, error: Exception | None) -> None:
        if not self._lost:
            self._lost = True
            self._on_lost(error)


async def open_port(options: PortOptions, clock: Clock) -> SerialPort:
    """Open a port and take it for this process alone.

    Raises:
        PortMissing: There is no such device.
        PortDenied: The user may not open it.
        PortBusy: Another process holds it; the message names it if that can be seen.
        LinkError: It is no serial port, or the kernel refuses it otherwise.
    """
    path = options.path
    try:
        device = _Serial(take(path, dtr=options.dtr, rts=options.rts), options.baudrate)
    except OSError as error:
        raise explained(path, error) from error
    try:
        device.configure(hangup_on_close=options.hangup_on_close)
    except (OSError, ValueError, termios.error) as error:
        device.close()
        raise explained(path, error) from error
    return await _carried(device, path, clock)


async def adopt(seized: Seized, clock: Clock) -> SerialPort:
    """Carry the bytes of a seized port; its descriptor is the port's from now on."""
    return await _carried(_Serial(seized.fd, seized.baudrate), seized.path, clock)


async def _carried(device: _Serial, path: str, clock: Clock) -> SerialPort:
    port = SerialPort(device, path, clock)
    try:
        # pyserial reads the port's settings once more, which fails if it hung up meanwhile.
        await serial_asyncio.connection_for_serial(asyncio.get_running_loop(), lambda: port, device)
    except OSError as error:
        device.close()
        raise lost(path, error) from error
    # The transport introduces itself in the loop's next iteration.
    await asyncio.sleep(0)
    return port
