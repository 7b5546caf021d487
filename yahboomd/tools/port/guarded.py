"""A port on which a tool turns wheels without a daemon, and the guard that stops them.

If the tool is killed, its guard stops the wheels. If the port goes away while wheels may turn, the
tool waits for the device, stops it, and ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator, Callable

from yahboomd.core.clock import Clock, nanoseconds, sleep_until
from yahboomd.core.config import Config
from yahboomd.core.errors import BoardError, LinkError, PortLost, YahboomdError
from yahboomd.core.link.port import Port, SerialPort
from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.takeover import TakeoverReport, take_over_seized
from yahboomd.core.link.vital_tasks import undisturbed
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.tools.port.guard import Guard
from yahboomd.tools.stop import replug
from yahboomd.tools.stop.stop_port import describe

PLUG_IN = (
    "{port} went away while wheels may turn, and they turn on. Plug the board in again, into the "
    "same socket, or switch the motors' supply off.\n"
    "The wheels are stopped as soon as the board is back. Ctrl-C ends the wait."
)
NOT_STOPPED = (
    "The board did not come back: the wheels may still turn. Switch the motors' supply off, or "
    "plug the board in and run `yahboomd stop`."
)
GUARD_WAITS = " If the board comes back within a minute, it is still stopped."


class LostInMotion(YahboomdError):
    """The port went away while wheels turned, and the tool stopped them: it may be run again."""

    exit_code = os.EX_TEMPFAIL


class LeftTurning(asyncio.CancelledError):
    """The tool was ended before it could stop wheels that may turn."""


class GuardedPort:
    """A port with its guard. A simulated line has no guard.

    Attributes:
        turning: Wheels were driven, and were not seen to stand yet.
    """

    def __init__(self, port: Port, config: Config) -> None:
        self._port = port
        self._guard: Guard | None = None
        self.turning = False
        self.note: PortNote | None = None
        if isinstance(port, SerialPort):
            serial = config.serial
            self.note = PortNote(
                path=port.name,
                baudrate=serial.baudrate,
                dtr=serial.dtr,
                rts=serial.rts,
                hangup_on_close=serial.hangup_on_close,
                device=identify(os.fstat(port.fileno())),
            )

    def watch_over(self, dialect: Dialect) -> None:
        """Start the guard.

        Raises:
            BoardError: It does not start.
        """
        if not isinstance(self._port, SerialPort):
            return
        stop = dialect.resync + (dialect.cut or dialect.brake)
        try:
            self._guard = Guard.start(self._port.fileno(), stop, self.note)
        except OSError as error:
            raise BoardError(f"No motor is turned: {error}.") from error

    def mark(self, turning: bool) -> None:
        """Record that wheels are about to be driven (True), or were seen to stand.

        Raises:
            BoardError: The guard is gone: no wheel must be driven.
        """
        self.turning = turning
        if self._guard is not None:
            self._guard.mark(turning)

    async def stop_when_back(self, clock: Clock, say: Callable[[str], None]) -> str:
        """Wait for the device, stop it, and release its port.

        Returns:
            The outcome, as sentences.

        Raises:
            LeftTurning: The wait was cancelled.
        """
        guard, self._guard = self._guard, None
        assert guard is not None
        assert self.note is not None
        guard.lose_port()
        say(PLUG_IN.format(port=self._port.name))
        try:
            words = await _stop_when_back(self.note, clock)
        except asyncio.CancelledError as error:
            by_person = error.args == ("SIGINT",)
            guard.dismiss() if by_person else guard.leave()
            # The terminal may be gone.
            with contextlib.suppress(OSError):
                say(NOT_STOPPED if by_person else NOT_STOPPED + GUARD_WAITS)
            raise LeftTurning from error
        guard.dismiss()
        return words

    def close(self) -> None:
        """End the guard, which first stops the wheels if they were not seen to stand."""
        if self._guard is not None:
            self._guard.close()


@contextlib.asynccontextmanager
async def guarded(
    port: Port, config: Config, clock: Clock, say: Callable[[str], None]
) -> AsyncIterator[GuardedPort]:
    """Make sure that wheels stop, whatever happens to the tool that turns them, or to the cable.

    Attend the line on the port inside of this context.

    Args:
        port: The open port.
        config: How it was opened.

    Raises:
        LostInMotion: The port went away while wheels turned, and they were stopped later.
    """
    found = GuardedPort(port, config)
    try:
        yield found
    except PortLost as lost:
        if not found.turning or found.note is None:
            raise
        words = await found.stop_when_back(clock, say)
        raise LostInMotion(f"{lost.message} {words}", remedy="Look at the cable.") from lost
    finally:
        # Ends last, because it takes a second if a wheel may turn.
        found.close()


async def _stop_when_back(note: PortNote, clock: Clock) -> str:
    while True:
        try:
            seized = replug.seize_again(note)
        except replug.TakenByOurs as taker:
            return f"{taker} now, and stops the wheels as it begins."
        if seized is not None:
            reports: list[TakeoverReport] = []

            async def take() -> None:
                reports.append(await take_over_seized(seized, clock))  # noqa: B023

            # The cable may be out again.
            with contextlib.suppress(LinkError):
                await undisturbed(take())
                return describe(reports[0])
        await sleep_until(clock, clock.now_ns() + nanoseconds(replug.LOOK_S))
