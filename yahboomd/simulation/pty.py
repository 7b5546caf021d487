"""A simulated robot on a pseudo-terminal, in real time: a host opens it like a serial port.

- Bytes are paced on an absolute schedule; the kernel's timer wakes the simulator when bytes are
  due, an incoming command wakes it at once.
- While no process has the port open, the board runs on, its output is lost, and the simulator
  polls every few milliseconds for a host (only a read from the pty shows one).
- If the host does not read, output that does not fit into the pty is lost, as with a UART.
- If the host writes faster than the wire carries, the simulator stops reading, and the host's
  buffer fills.
- Unplugging closes the pty, which the host sees as a hang-up, and removes the link; replugging
  makes a new pty behind the same link.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import termios
import tty
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol, TypeVar

from yahboomd.core.clock import Alarm, SystemClock
from yahboomd.core.errors import ConfigError
from yahboomd.simulation.console import execute, serve_control
from yahboomd.simulation.heard import HeardWriter
from yahboomd.simulation.lines import LinesWriter
from yahboomd.simulation.port_link import claim, point, unpoint
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.truth import TruthWriter

Writer = TypeVar("Writer", bound=LinesWriter)

READ_BYTES = 4096
BACKLOG_NS = 40_000_000
"""Bytes read from a host in advance, by their time on the wire: some 460 bytes at 115200 baud."""


class FarEnd(Protocol):
    """The device behind a port: a simulated robot, or another one that is moved through time.

    Attributes:
        on_plug: Called when the USB plug comes out (False) or goes in (True).
    """

    on_plug: Callable[[bool], None] | None

    def start(self, now_ns: int) -> None:
        """Begin at this moment."""

    @property
    def next_ns(self) -> int:
        """The next moment at which :meth:`host_reads` is worth calling."""

    def host_reads(self, now_ns: int) -> list[bytes]:
        """Run everything due, and take the chunks that have arrived at the host."""

    def host_wrote(self, data: bytes, now_ns: int) -> None:
        """The host has written ``data``."""

    def host_backlog_ns(self, now_ns: int) -> int:
        """The time until all bytes of the host will have arrived."""


class PtyPort:
    """The board's end of a pty.

    Attributes:
        name: The path, such as ``/dev/pts/5``; empty while unplugged.
        dropped_bytes: The board's bytes that no host took.
        on_heard: Takes the host's bytes, and their time.
        ended: Done with the exception if the port fails.

    Args:
        link: A symbolic link to the port, kept up to date.
    """

    def __init__(self, device: FarEnd, *, link: Path | None = None) -> None:
        self._device = device
        self.link = link
        self.name = ""
        self.dropped_bytes = 0
        self.on_heard: Callable[[bytes, int], None] | None = None
        self.ended: asyncio.Future[None]
        self._clock = SystemClock()
        self._loop: asyncio.AbstractEventLoop
        self._alarm: Alarm
        self._master = -1
        self._host = False
        self._reading = False

    @property
    def has_host(self) -> bool:
        """Whether a process has the port open, as seen at the latest check."""
        return self._host

    def open(self) -> None:
        """Make the pty and the link, and start, on the running loop.

        Raises:
            ConfigError: The link cannot be made.
            OSError: The system has no pty for us.
        """
        self._loop = asyncio.get_running_loop()
        self.ended = self._loop.create_future()
        self._alarm = self._clock.alarm(self._wake)
        try:
            self._plug_in()
        except BaseException:
            self.close()
            raise
        self._device.start(self._clock.now_ns())
        self._device.on_plug = self._plugged
        self._alarm.set(self._device.next_ns)

    def close(self) -> None:
        """Hang up, remove the link; safe to call twice."""
        self._device.on_plug = None
        self._alarm.close()
        self._pull_out()

    # On the loop.

    def _wake(self) -> None:
        try:
            chunks = self._device.host_reads(self._clock.now_ns())
            if chunks:
                self._write(b"".join(chunks) if len(chunks) > 1 else chunks[0])
            if self._master >= 0 and not self._reading and not self._stuffed():
                self._read()
            self._schedule()
        except Exception as why:  # noqa: BLE001 - a callback cannot raise it
            self._fail(why)

    def _readable(self) -> None:
        try:
            self._read()
            self._schedule()
        except Exception as why:  # noqa: BLE001 - a callback cannot raise it
            self._fail(why)

    def _fail(self, why: Exception) -> None:
        if not self.ended.done():
            self.ended.set_exception(why)

    def _schedule(self) -> None:
        self._alarm.set(self._device.next_ns)

    def _stuffed(self) -> bool:
        return self._device.host_backlog_ns(self._clock.now_ns()) > BACKLOG_NS

    def _read(self) -> None:
        if self._master < 0:
            return
        try:
            data = os.read(self._master, READ_BYTES)
        except BlockingIOError:
            self._host_is_there()
            return
        except OSError:
            # EIO: no process has the other end open.
            self._host_is_gone()
            return
        if not data:
            self._host_is_gone()
            return
        now_ns = self._clock.now_ns()
        self._host_is_there()
        if self.on_heard is not None:
            self.on_heard(data, now_ns)
        self._device.host_wrote(data, now_ns)
        if self._stuffed():
            self._stop_reading()

    def _host_is_there(self) -> None:
        self._host = True
        if not self._reading:
            self._reading = True
            self._loop.add_reader(self._master, self._readable)

    def _host_is_gone(self) -> None:
        self._stop_reading()
        if not self._host:
            return
        self._host = False
        # The next host must not read bytes that were meant for this one.
        with contextlib.suppress(OSError, termios.error):
            slave = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                termios.tcflush(slave, termios.TCIFLUSH)
            finally:
                os.close(slave)

    def _stop_reading(self) -> None:
        # A pty without a host is always readable: the loop would spin.
        if self._reading:
            self._reading = False
            self._loop.remove_reader(self._master)

    def _write(self, data: bytes) -> None:
        written = 0
        if self._master >= 0 and self._host:
            with contextlib.suppress(OSError):
                written = os.write(self._master, data)
        self.dropped_bytes += len(data) - written

    # The plug.

    def _plugged(self, plugged: bool) -> None:
        if plugged:
            self._plug_in()
        else:
            self._pull_out()

    def _plug_in(self) -> None:
        master, slave = os.openpty()
        try:
            tty.setraw(slave)
            self.name = os.ttyname(slave)
            os.set_blocking(master, False)
            if self.link is not None:
                point(self.link, self.name)
        except BaseException:
            os.close(master)
            raise
        finally:
            os.close(slave)
        self._master = master

    def _pull_out(self) -> None:
        if self._master < 0:
            return
        self._stop_reading()
        if self.link is not None:
            unpoint(self.link, self.name)
        os.close(self._master)
        self._master = -1
        self._host = False
        self.name = ""


class RobotPort(PtyPort):
    """The port of a simulated robot, which takes control commands."""

    def __init__(self, robot: SimulatedRobot, *, link: Path | None = None) -> None:
        super().__init__(robot, link=link)
        self.robot = robot

    def command(self, line: str) -> str:
        """Carry out a control command, and return its answer."""
        answer = execute(self.robot, line, self._clock.now_ns())
        if self._stuffed():
            self._stop_reading()
        self._schedule()
        return answer

    def _stuffed(self) -> bool:
        stalled = self._clock.now_ns() < self.robot.impairments.stalled_until_ns
        return stalled or super()._stuffed()


async def serve(
    robot: SimulatedRobot,
    *,
    link: Path | None = None,
    truth: Path | None = None,
    heard: Path | None = None,
    control: Path | None = None,
    at_start: Sequence[str] = (),
    ready: Callable[[RobotPort], None] = lambda _port: None,
) -> None:
    """Serve a robot on a pty until cancelled.

    Args:
        robot: The robot; its time starts now.
        control: A unix socket that takes control commands.
        at_start: Control commands to carry out first.
        ready: Called once the port can be opened.

    Raises:
        ConfigError: A path cannot be used, or a command of ``at_start`` is wrong.
        OSError: The system has no pty for us.
    """
    port = RobotPort(robot, link=link)
    async with contextlib.AsyncExitStack() as stack:
        if link is not None:
            stack.enter_context(claim(link))
        if truth is not None:
            followed = _opened(TruthWriter(truth), truth, "The ground truth")
            stack.callback(followed.close)
            robot.on_truth = followed.write
        if heard is not None:
            listened = _opened(HeardWriter(heard), heard, "The bytes of the host")
            stack.callback(listened.close)
            port.on_heard = listened.note
        port.open()
        stack.callback(port.close)
        for line in at_start:
            answer = port.command(line)
            if not answer.startswith("ok"):
                raise ConfigError(f"{line!r} at the start: {answer.removeprefix('error ')}.")
        if control is not None:
            server = await serve_control(control, port.command)
            stack.callback(control.unlink, missing_ok=True)
            stack.callback(server.close)
        ready(port)
        await port.ended


def _opened(writer: Writer, path: Path, what: str) -> Writer:
    try:
        writer.open()
    except OSError as why:
        raise ConfigError(f"{what} cannot be written to {path}: {why.strerror or why}.") from why
    return writer
