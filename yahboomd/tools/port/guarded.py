"""A port on which a tool turns wheels without a daemon, and the guard that stops them.

If the tool is killed, or the port goes away while wheels may turn, its guard stops the wheels and
sees them stand. The tool waits for that, and ends. The guard listens for local stops, too: one ends
the tool as SIGTERM does, and is answered once the port is free.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from pathlib import Path

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.config import runtime_folder
from yahboomd.core.errors import BoardError, PortLost, Refused, YahboomdError
from yahboomd.core.link.guard_words import STOP_SOCKET, Listening
from yahboomd.core.link.line import Line
from yahboomd.core.link.port import SerialPort
from yahboomd.core.link.port_guard import ENDS_WITHIN_S, PortGuard
from yahboomd.core.protocol.dialect import Dialect

SERVICES_FOLDER = Path("/run/yahboomd")
"""It stays when the service ends, and belongs to the service's user."""

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

    def __init__(self, line: Line) -> None:
        self._line = line
        self._port = line.port
        port = line.port
        self._guard = (port.guard if isinstance(port, SerialPort) else None) or PortGuard()
        self.turning = False

    async def watch_over(self, dialect: Dialect) -> None:
        """See that the guard has the port of this board.

        Raises:
            BoardError: It has not.
        """
        if isinstance(self._port, SerialPort) and not await self._line.share(self._guard, dialect):
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
        """Leave the wheels to the guard if they were not seen to stand: it stops them, and ends."""
        report = self._line.report
        if report is not None and report.doubt is None:
            self._guard.standing()
        else:
            self._guard.end(ENDS_WITHIN_S)


@contextlib.asynccontextmanager
async def guarded(line: Line, say: Callable[[str], None]) -> AsyncIterator[GuardedPort]:
    """Make sure that wheels stop, whatever happens to the tool that turns them, or to the cable.

    Attend the line inside of this context.

    Raises:
        LostInMotion: The port went away while wheels turned, and they were stopped later.
    """
    found = GuardedPort(line)
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


def tools_folder(environ: Mapping[str, str], *, user_id: int) -> Path:
    """The folder of a tool's stop socket: the daemon's, but one of its own for root.

    The service's user could remove the socket of root's tool.
    """
    folder = runtime_folder(environ, user_id=user_id)
    # A stop finds it among those of the services, whose names begin in the same way.
    return Path("/run/yahboomd-root") if folder == SERVICES_FOLDER else folder


@contextlib.asynccontextmanager
async def ended_by_stops(
    guard: PortGuard, command: str, port: str, environ: Mapping[str, str], clock: Clock
) -> AsyncIterator[None]:
    """Run a guard whose local stops end this process, which handles SIGTERM already.

    Args:
        command: Its name, such as ``tune``.
        port: The port that it takes.

    Raises:
        BoardError: The guard does not start.
        Refused: There can be no socket: no wheel must be turned.
    """
    asked, said, left_turning = 0, "", False

    def on_stop(number: int, by: str) -> None:
        nonlocal asked, said
        said = f"`yahboomd {command}` is ended by {by}, and stops the wheels first."
        asked = number
        guard.obey(number)
        signal.raise_signal(signal.SIGTERM)

    folder = tools_folder(environ, user_id=os.getuid())
    facts = {"daemon": "yahboomd", "pid": os.getpid(), "command": command, "ports": [port]}
    try:
        guard.begin()
    except OSError as error:
        raise BoardError(f"The guard does not start ({error}): no wheel is turned.") from error
    try:
        guard.show(msgspec.json.encode(facts))
        listening = Listening(str(folder), f"{STOP_SOCKET}-{command}")
        if not await guard.listen(listening, on_stop, clock):
            raise Refused(
                f"There is no stop socket in {folder}, so that `yahboomd stop` could not end this "
                "command: no wheel is turned.",
                remedy="May this user write there? Else set RUNTIME_DIRECTORY to another folder.",
            )
        yield
    except LeftTurning:
        left_turning = True
        raise
    finally:
        if asked:
            line = {"engaged": True, "sent": not left_turning, "message": said}
            guard.answer(asked, msgspec.json.encode(line))
        guard.end(ENDS_WITHIN_S)
