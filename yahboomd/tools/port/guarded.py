"""A port on which a tool turns wheels without a daemon, and the guard that stops them.

If the tool is killed, or the port goes away while wheels may turn, its guard stops the wheels and
sees them stand. The tool waits for that, and ends.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import AsyncIterator, Callable

from yahboomd.core.config import Config
from yahboomd.core.errors import BoardError, PortLost, YahboomdError
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import PortOptions, SerialPort
from yahboomd.core.link.port_guard import ENDS_WITHIN_S, PortGuard
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.tools.port import charge

PROMISED_NS = 600_000_000
"""A little longer than a pulse; after it the guard stops the wheels, whatever the tool does."""

PLUG_IN = (
    "{port} went away while wheels may turn, and they turn on. Plug the board in again, into the "
    "same socket, or switch the motors' supply off.\n"
    "The wheels are stopped as soon as the board is back. Ctrl-C ends the wait."
)
NOT_STOPPED = (
    "The board did not come back: the wheels may still turn. Switch the motors' supply off, or "
    "plug the board in and run `yahboomd stop`."
)
GUARD_WAITS = " If it comes back before that, a guard that waits for it stops the wheels."


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

    def __init__(self, line: Line, config: Config) -> None:
        self._line = line
        self._port = line.port
        self._serial = config.serial
        self._guard = PortGuard(charge.start, renewed=False)
        self.turning = False

    async def watch_over(self, dialect: Dialect) -> None:
        """Start the guard.

        Raises:
            BoardError: It does not start.
        """
        port, serial = self._port, self._serial
        if not isinstance(port, SerialPort):
            return
        options = PortOptions(
            path=port.name,
            baudrate=serial.baudrate,
            dtr=serial.dtr,
            rts=serial.rts,
            hangup_on_close=serial.hangup_on_close,
        )
        with contextlib.suppress(OSError):
            self._guard.begin()
            port.share(self._guard, options)
            if await self._line.share(self._guard, dialect):
                self._guard.standing()
                return
        raise BoardError(
            "No motor is turned: the process that would stop the wheels after a crash does not "
            "start."
        )

    def mark(self, turning: bool) -> None:
        """Record that wheels are about to be driven (True), or were seen to stand.

        Raises:
            BoardError: The guard is gone: no wheel must be driven.
        """
        self.turning = turning
        if not isinstance(self._port, SerialPort):
            return
        if turning:
            self._guard.promise(self._line.clock.now_ns() + PROMISED_NS)
        else:
            self._guard.standing()
        if self._guard.gone:
            raise BoardError(
                "The process that stops the wheels after a crash has ended: no motor is turned."
            )

    async def stop_when_back(self, say: Callable[[str], None]) -> str:
        """Wait until the guard has found the device, and seen its wheels stand.

        Returns:
            The outcome, as sentences.

        Raises:
            LeftTurning: The wait was cancelled.
        """
        say(PLUG_IN.format(port=self._port.name))
        try:
            words = await self._guard.outcome(self._line.clock)
        except asyncio.CancelledError as error:
            by_person = error.args == ("SIGINT",)
            self._guard.dismiss() if by_person else self._guard.end()
            # The terminal may be gone.
            with contextlib.suppress(OSError):
                say(NOT_STOPPED if by_person else NOT_STOPPED + GUARD_WAITS)
            raise LeftTurning from error
        return words or NOT_STOPPED

    def close(self) -> None:
        """End the guard, which first stops the wheels if they were not seen to stand."""
        report = self._line.report
        if report is not None and report.doubt is None:
            self._guard.standing()
        self._guard.end(ENDS_WITHIN_S)


@contextlib.asynccontextmanager
async def guarded(
    line: Line, config: Config, say: Callable[[str], None]
) -> AsyncIterator[GuardedPort]:
    """Make sure that wheels stop, whatever happens to the tool that turns them, or to the cable.

    Attend the line inside of this context.

    Args:
        config: How its port was opened.

    Raises:
        LostInMotion: The port went away while wheels turned, and they were stopped later.
    """
    found = GuardedPort(line, config)
    try:
        yield found
    except PortLost as lost:
        if not found.turning:
            raise
        words = await found.stop_when_back(say)
        raise LostInMotion(f"{lost.message} {words}", remedy="Look at the cable.") from lost
    finally:
        # Ends last, because it takes a second if a wheel may turn.
        found.close()
