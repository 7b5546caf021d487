"""The serial port: opened once, owned alone, never blocking.

pyserial-asyncio carries the bytes. Three of its ways do not fit a program that stops wheels, and
are mended here, at the edge:

- its ``write`` waits for the loop to report the port writable; a frame that finds the port free is
  written at once, and its buffer takes only what the kernel did not;
- its close calls ``tcdrain`` on the loop's thread, and the kernel waits again for output that
  is not read: both are cut short by discarding the output first, so draining is ours to do, with
  a deadline (:meth:`SerialPort.drain`);
- a read that fails while output is waiting makes it wait for the output first; where the device
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
from collections.abc import Callable
from typing import Protocol, cast

import msgspec
import serial
import serial_asyncio

from yahboomd.clock import NS_PER_S, Clock
from yahboomd.link.draining import drained, drop, in_kernel
from yahboomd.link.port_errors import explained
from yahboomd.link.seize import keep_out

BITS_PER_BYTE = 10  # 8N1: a start bit, eight of data, a stop bit

READ_BYTES = 1024

MAX_PENDING = 4096
"""Output the kernel would not take, in bytes; beyond that the port counts as stuck."""


def byte_time_ns(baudrate: int) -> int:
    """How long one byte is on the wire (86.8 us at 115200)."""
    return BITS_PER_BYTE * NS_PER_S // baudrate


class PortOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How a port is opened.

    Attributes:
        path: The device, such as ``/dev/yahboom_driver``.
        baudrate: Bits per second.
        dtr: State of DTR, set before the port opens (the board wires it to its reset).
        rts: State of RTS, likewise (wired to the boot selection).
        hangup_on_close: Leave HUPCL set: closing drops DTR, which may reset the board.
    """

    path: str
    baudrate: int = 115200
    dtr: bool = True
    rts: bool = False
    hangup_on_close: bool = False


class Port(Protocol):
    """What the session needs of a port; the simulated one in memory offers the same."""

    @property
    def name(self) -> str:
        """What messages call it."""
        ...

    @property
    def byte_ns(self) -> int:
        """Nanoseconds that a byte takes on the wire."""
        ...

    @property
    def queued(self) -> int:
        """Bytes written here and not on the wire yet, as far as the system knows."""
        ...

    def listen(
        self, on_data: Callable[[bytes], None], on_lost: Callable[[Exception | None], None]
    ) -> None:
        """Tell who hears bytes and the loss of the port."""
        ...

    def write(self, data: bytes) -> None:
        """Send; never blocks and never raises: a lost port is reported to ``on_lost``."""
        ...

    def gather(self, least: int) -> None:
        """Hear bytes once so many are there, where the port can wait for them."""
        ...

    def look(self) -> None:
        """Hear what is there now, however little."""
        ...

    def discard(self) -> None:
        """Drop what is not on the wire, where the driver can: it may cut a frame in half."""
        ...

    async def drain(self, timeout_s: float) -> bool:
        """Wait until everything is on the wire; whether it is."""
        ...

    def close(self) -> None:
        """Let go at once; what is not on the wire is discarded."""
        ...


class _Serial(serial.Serial):
    """A serial object whose ways fit an event loop."""

    on_broken: Callable[[Exception], None] | None = None

    def read(self, size: int = 1) -> bytes:
        try:
            # The event loop has looked whether there is something; pyserial would look again. With
            # nothing there it has to: only then does nothing mean that the device is gone.
            return os.read(self.fileno(), size) or super().read(size)
        except BlockingIOError:
            return b""
        except (serial.SerialException, OSError, ValueError) as error:
            # A ValueError is select's, of a descriptor beyond 1023.
            if self.on_broken is not None:
                self.on_broken(error)
            raise serial.SerialException(str(error)) from error

    def write(self, data: bytes) -> int:  # type: ignore[override]
        try:
            return os.write(self.fileno(), data)
        except BlockingIOError:
            return 0
        except OSError as error:
            raise serial.SerialException(str(error)) from error

    def flush(self) -> None:
        """Not here: it is ``tcdrain``, which would block the loop. See ``SerialPort.drain``."""

    def close(self) -> None:
        if self.is_open and self.fd is not None:
            # The kernel, too, would wait for output that the device does not read.
            drop(self.fd)
            with contextlib.suppress(OSError):
                fcntl.ioctl(self.fd, termios.TIOCNXCL)
        super().close()


class SerialPort(asyncio.Protocol):
    """A real port (a pty counts as one). Made by :func:`open_port`."""

    def __init__(self, device: _Serial, options: PortOptions, clock: Clock) -> None:
        self._device = device
        self._clock = clock
        self._transport: serial_asyncio.SerialTransport | None = None
        self._on_data: Callable[[bytes], None] = lambda _data: None
        self._on_lost: Callable[[Exception | None], None] = lambda _error: None
        self._lost = False
        self._fd: int = device.fileno()
        self.name = options.path
        self.byte_ns = byte_time_ns(options.baudrate)
        device.on_broken = self._broken

    # What asyncio calls.

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Keep the transport."""
        self._transport = transport

    def data_received(self, data: bytes) -> None:
        """Hand bytes on."""
        self._on_data(data)

    def connection_lost(self, exc: Exception | None) -> None:
        """Report a port that went away."""
        self._transport = None
        self._report(exc)

    # What the session calls.

    def listen(
        self, on_data: Callable[[bytes], None], on_lost: Callable[[Exception | None], None]
    ) -> None:
        """See :class:`Port`."""
        self._on_data = on_data
        self._on_lost = on_lost

    @property
    def pending(self) -> int:
        """Bytes that the kernel did not take yet."""
        if self._transport is None or self._lost:
            return 0
        return cast(int, self._transport.get_write_buffer_size())

    @property
    def queued(self) -> int:
        """See :class:`Port`."""
        return 0 if self._lost else self.pending + in_kernel(self._fd)

    def discard(self) -> None:
        """See :class:`Port`."""
        if not self._lost:
            drop(self._fd)

    def write(self, data: bytes) -> None:
        """See :class:`Port`."""
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
        elif pending > MAX_PENDING:
            self._broken(OSError(errno.ETIMEDOUT, "the port takes no output"))
            return
        self._transport.write(data)

    def gather(self, least: int) -> None:
        """See :class:`Port`."""
        if self._lost:
            return
        try:
            attributes = termios.tcgetattr(self._fd)
            attributes[6][termios.VMIN] = least
            termios.tcsetattr(self._fd, termios.TCSANOW, attributes)
        except (OSError, termios.error) as error:
            self._broken(error)

    def look(self) -> None:
        """See :class:`Port`."""
        # Whatever is wrong with the port, the event loop hears of it by itself.
        if self._lost:
            return
        try:
            data = os.read(self._fd, READ_BYTES)
        except OSError:
            return
        if data:
            self._on_data(data)

    async def drain(self, timeout_s: float) -> bool:
        """See :class:`Port`."""

        def waiting() -> int | None:
            return None if self._lost else self.queued

        return await drained(self._clock, waiting, byte_ns=self.byte_ns, timeout_s=timeout_s)

    def close(self) -> None:
        """See :class:`Port`."""
        self._on_data = lambda _data: None
        self._on_lost = lambda _error: None
        self._lost = True
        self._abort()

    def _broken(self, error: Exception) -> None:
        self._report(error)
        # Not at once: the transport may be in the middle of finding out for itself.
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
        PortBusy: Another process holds it; the message names it where that can be seen.
        LinkError: It is no serial port, or the kernel refuses it otherwise.
    """
    device = _Serial()
    device.port = options.path
    device.baudrate = options.baudrate
    device.timeout = 0
    device.write_timeout = 0
    device.exclusive = True
    device.dtr = options.dtr
    device.rts = options.rts
    try:
        device.open()
    except (OSError, termios.error) as error:
        raise explained(options.path, error) from error
    try:
        _claim(device, hangup_on_close=options.hangup_on_close)
    except (OSError, termios.error) as error:
        device.close()
        raise explained(options.path, error) from error
    port = SerialPort(device, options, clock)
    await serial_asyncio.connection_for_serial(asyncio.get_running_loop(), lambda: port, device)
    # The transport introduces itself at the loop's next turn.
    await asyncio.sleep(0)
    return port


def _claim(device: _Serial, *, hangup_on_close: bool) -> None:
    """Keep those out who ask for no lock, and say what becomes of DTR when we leave."""
    keep_out(device.fileno())
    attributes = termios.tcgetattr(device.fileno())
    attributes[2] = (attributes[2] & ~termios.HUPCL) | (termios.HUPCL if hangup_on_close else 0)
    termios.tcsetattr(device.fileno(), termios.TCSANOW, attributes)
