"""A board and somebody who asks it questions: nothing drives it. For `stop` and `probe`.

The daemon's session keeps a connection alive; a conversation has a beginning and an end. It stops
the wheels before it asks anything, and leaves with the motors let go, whatever happens in between.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Self, TypeVar

import msgspec

from yahboomd.clock import Clock, nanoseconds, sleep_until
from yahboomd.errors import PortLost
from yahboomd.link import handshake
from yahboomd.link.port import Port
from yahboomd.link.port_errors import lost, takes_no_output
from yahboomd.link.reception import Ears, Reception
from yahboomd.link.standstill import StandstillWatch
from yahboomd.link.start_notices import StartNotices
from yahboomd.link.stopping import DRAIN_S, StopReport, bring_to_rest, stop_unidentified
from yahboomd.link.writer import Writer
from yahboomd.model import Counts
from yahboomd.protocol.dialect import (
    Battery,
    Decoded,
    Dialect,
    FramerCounters,
    Item,
    Totals,
)
from yahboomd.protocol.settings import BoardSettings

T = TypeVar("T")

STILL_TICKS_PER_S = 100.0
"""Below it a wheel counts as standing where no wheel is configured: six counts in the watch's
window, at most 25 mm/s at the rim with any of the vendor's gears that has an encoder."""

ASK_ATTEMPTS = 3
COUNTERS_WITHIN_S = 0.1
BATTERY_WITHIN_S = 0.15
POLL_PERIOD_S = 0.02

KEPT_BYTES = 512


class Heard(msgspec.Struct, kw_only=True):
    """What came from the port, to explain a board that is none.

    Attributes:
        start: The first bytes, half a kilobyte at most.
        counters: What the framer made of everything.
        resets: How often the board announced a restart.
    """

    start: bytes = b""
    counters: FramerCounters
    resets: int = 0


class Conversation:
    """One connection without motion. Enter it to listen; leaving it stops the wheels and closes.

    Args:
        port: The open port.
        clock: What tells the time.
        still_ticks_per_s: Below it a wheel counts as standing.
    """

    def __init__(
        self, port: Port, clock: Clock, *, still_ticks_per_s: float = STILL_TICKS_PER_S
    ) -> None:
        self._port = port
        self._clock = clock
        self._reception = Reception(self._understand)
        self._writer: Writer | None = None
        self._writing: asyncio.Task[None] | None = None
        self._notices = StartNotices()
        self._at_rest = False
        self._gone: asyncio.Future[PortLost]
        self.watch = StandstillWatch(still_ticks_per_s)
        self.dialect: Dialect | None = None
        self.ticks: Counts | None = None
        self.heard = Heard(counters=self._reception.counters)
        self.report: StopReport | None = None

    async def __aenter__(self) -> Self:
        self._gone = asyncio.get_running_loop().create_future()
        self._port.listen(self._data, self._lost)
        return self

    async def __aexit__(self, *_: object) -> None:
        try:
            if not self._gone.done() and not self._at_rest:
                await self._say_goodbye()
        finally:
            if self._writing is not None:
                self._writing.cancel()
                await asyncio.gather(self._writing, return_exceptions=True)
            self._port.close()
            self._gone.cancel()
            # pyserial-asyncio closes the device in the loop's next iteration: a process
            # that opens it again must not find it held by us.
            await asyncio.sleep(0)
            await asyncio.sleep(0)

    @property
    def port_name(self) -> str:
        """The port, by name."""
        return self._port.name

    async def identify(self, wanted: str = "auto", *, stop_first: bool = True) -> Dialect:
        """Stop the wheels, and find out who is there.

        Args:
            wanted: ``auto``, or the only dialect to accept.
            stop_first: The stop of an unknown board has not been said on this port yet.

        Raises:
            BoardSilent: Nothing answered like a board.
            BoardError: It answered in the other dialect than the wanted one.
            PortLost: The port went away.
        """
        if stop_first and not await self._unless_lost(stop_unidentified(self._port, self._clock)):
            raise takes_no_output(self.port_name)
        dialect = await self._unless_lost(
            handshake.identify(self._port, self._clock, wanted, self._hear)
        )
        self._writer = Writer(
            self._port,
            self._clock,
            resend_ns=nanoseconds(1.0),
            spacing_ns=dialect.spacing_ns,
        )
        self._writing = asyncio.create_task(self._writer.run(), name="conversation-writer")
        self.dialect = dialect
        for decoded in self._reception.choose(dialect):
            self._notice_start(decoded)
        self.heard.counters = self._reception.counters
        return dialect

    async def request(
        self, frame: bytes, answered: Callable[[Decoded], bool], timeout_s: float
    ) -> bool:
        """Send one frame and wait for its answer; whether it came.

        Raises:
            PortLost: The port went away.
        """
        assert self._writer is not None, "identify comes first"
        self._at_rest = False
        return await self._unless_lost(self._writer.request(frame, answered, timeout_s))

    async def read_settings(self, expected: BoardSettings) -> BoardSettings | None:
        """What the board stores; None for a dialect that stores nothing.

        Args:
            expected: A value that differs from it is believed when it was said twice.

        Raises:
            BoardSilent: The board does not tell.
            PortLost: The port went away.
        """
        assert self._writer is not None, "identify comes first"
        assert self.dialect is not None
        return await self._unless_lost(
            handshake.read_settings(self._writer, self.dialect, expected, self.port_name)
        )

    async def read_battery(self) -> float | None:
        """The voltage of the motors' supply; None where the board does not tell."""
        assert self.dialect is not None, "identify comes first"
        volts: list[float] = []

        def answered(said: Decoded) -> bool:
            if isinstance(said, Battery):
                volts.append(said.volts)
            return bool(volts)

        if self.dialect.battery is not None:
            for _ in range(ASK_ATTEMPTS):
                if await self.request(self.dialect.battery, answered, BATTERY_WITHIN_S):
                    return volts[-1]
        return None

    async def read_counters(self) -> Counts | None:
        """The counters now; None where they do not come. A stream is left switched on."""
        assert self.dialect is not None, "identify comes first"
        frames = self.dialect.arm if self.dialect.poll is None else (self.dialect.poll,)
        for _ in range(ASK_ATTEMPTS):
            # A board that counts unasked gets no question, and is waited for the same way.
            for frame in frames or (b"",):
                if await self.request(frame, _is_totals, COUNTERS_WITHIN_S):
                    return self.ticks
        return None

    async def rest(self) -> StopReport:
        """Bring the wheels to rest and let the motors go; streams are off afterwards.

        Where the brake is not obeyed the motors are cut, and watched while they coast.

        Raises:
            PortLost: The port went away.
        """
        assert self.dialect is not None, "identify comes first"
        self.report = await self._unless_lost(
            bring_to_rest(self._port, self._clock, self.dialect, self.watch)
        )
        self._at_rest = True
        return self.report

    async def watch_wheels(self, within_s: float) -> bool | None:
        """Whether the wheels come to stand in time; None where the counters do not come.

        Raises:
            PortLost: The port went away.
        """
        assert self.dialect is not None, "identify comes first"
        self.watch.forget()
        deadline_ns = self._clock.now_ns() + nanoseconds(within_s)
        while not self.watch.standing and self._clock.now_ns() < deadline_ns:
            if self.dialect.poll is not None or self.watch.speed is None:
                await self.read_counters()
            await self._unless_lost(self._pause(POLL_PERIOD_S))
        return None if self.watch.speed is None else self.watch.standing

    # Leaving.

    async def _say_goodbye(self) -> None:
        if self.dialect is None:
            await stop_unidentified(self._port, self._clock)
            await self._port.drain(DRAIN_S)
        else:
            self.report = await bring_to_rest(self._port, self._clock, self.dialect, self.watch)

    # What comes in.

    def _data(self, data: bytes) -> None:
        if len(self.heard.start) < KEPT_BYTES:
            self.heard.start = (self.heard.start + data)[:KEPT_BYTES]
        self._reception.take(data, self._clock.now_ns())

    def _understand(self, decoded: Decoded, item: Item, now_ns: int) -> None:
        if isinstance(decoded, Totals):
            self.ticks = decoded.ticks
            self.watch.see(decoded.ticks, now_ns - item.trailing * self._port.byte_ns)
        self._notice_start(decoded)
        if self._writer is not None:
            self._writer.heard(decoded)

    def _notice_start(self, decoded: Decoded) -> None:
        if self._notices.judge(decoded) != "none":
            # Maybe an answer that lost its first line; the counters tell, where it matters.
            self.heard.resets += 1
            self.watch.forget()

    def _hear(self, ears: Ears | None) -> None:
        self._reception.ears = ears

    def _lost(self, error: Exception | None) -> None:
        if not self._gone.done():
            self._gone.set_result(lost(self._port.name, error))

    async def _pause(self, s: float) -> None:
        await sleep_until(self._clock, self._clock.now_ns() + nanoseconds(s))

    async def _unless_lost(self, work: Coroutine[Any, Any, T]) -> T:
        """Do it, but do not wait for answers of a port that is gone."""
        task = asyncio.ensure_future(work)
        try:
            both: set[asyncio.Future[Any]] = {task, self._gone}
            await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        finally:
            if not task.done():
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
        if self._gone.done():
            if not task.cancelled():
                task.exception()  # what the work made of it is an echo
            raise self._gone.result()
        return task.result()


def _is_totals(said: Decoded) -> bool:
    return isinstance(said, Totals)
