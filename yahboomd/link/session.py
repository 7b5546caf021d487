"""One connection to a board, from opening the port to letting it go.

The session owns the stream. In one task group run the writer, the poller and the watch on the port;
when one dies, so does the session, and its ``finally`` stops the wheels itself, bounded in time.
It never reconnects: the supervisor does.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from typing import Protocol

import msgspec

from yahboomd.clock import Clock, nanoseconds, sleep_until
from yahboomd.errors import PortLost, YahboomdError
from yahboomd.link import handshake
from yahboomd.link.handshake import Identity
from yahboomd.link.poller import Poller
from yahboomd.link.port import Port
from yahboomd.link.port_errors import lost
from yahboomd.link.reception import Reception
from yahboomd.link.standstill import StandstillWatch
from yahboomd.link.stopping import (
    DRAIN_S,
    StopReport,
    bring_to_rest,
    stop_unidentified,
    undisturbed,
)
from yahboomd.link.writer import Writer
from yahboomd.model import EncoderReading, Event
from yahboomd.protocol.dialect import (
    Battery,
    Decoded,
    Reply,
    Totals,
    Unrecognised,
    VersionLine,
)
from yahboomd.protocol.framing import Frame, TextLine
from yahboomd.protocol.settings import PROFILES, MotorProfile

BATTERY_ANSWER_S = 0.3


class SessionOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How a session behaves.

    Attributes:
        dialect: ``auto``, or the only one to accept.
        poll_rate_hz: Polls per second of a board that is polled.
        resend_s: How often the current velocity is said again.
        still_ticks_per_s: Below it a wheel counts as standing.
        profile: The motors; a board that stores no type is told it at each start.
        battery_period_s: How often the voltage is asked for, where the dialect can; 0 for never.
    """

    dialect: str = "auto"
    poll_rate_hz: float = 50.0
    resend_s: float = 0.1
    still_ticks_per_s: float = 190.0
    profile: MotorProfile = PROFILES["520"]
    battery_period_s: float = 5.0


class Listener(Protocol):
    """Who hears what the board does. Called on the loop, at arrival; must not block."""

    def connected(self, session: Session, identity: Identity) -> None:
        """The board is known and armed; counts follow."""
        ...

    def reading(self, reading: EncoderReading) -> None:
        """Counts arrived."""
        ...

    def battery(self, volts: float) -> None:
        """The voltage of the motors' supply."""
        ...

    def board_reset(self, version: str) -> None:
        """The board started anew by itself: its motors are free, its counters at zero."""
        ...

    def event(self, event: Event) -> None:
        """Something a person may have to know."""
        ...

    def leaving(self) -> None:
        """The session ends, and stops the wheels by itself: no command reaches them any more."""
        ...


Opener = Callable[[], Awaitable[Port]]


class Session:
    """One connection. ``run`` is called once.

    Args:
        opener: Opens the port.
        clock: What tells the time.
        listener: Hears what the board does.
        options: See :class:`SessionOptions`.
    """

    def __init__(
        self, opener: Opener, clock: Clock, listener: Listener, options: SessionOptions
    ) -> None:
        self._opener = opener
        self._clock = clock
        self._listener = listener
        self._options = options
        self._reception = Reception(self._understand)
        self._watch = StandstillWatch(options.still_ticks_per_s)
        self._port: Port | None = None
        self._identity: Identity | None = None
        self._writer: Writer | None = None
        self._poller: Poller | None = None
        self._gone: asyncio.Future[Exception] | None = None
        self._vital: list[asyncio.Task[None]] = []
        self._port_lost = False
        self._asking_settings = False
        self._leaving = False
        self._let_go = False
        self.counters: Counter[str] = Counter()
        self.report: StopReport | None = None

    # Commands to the wheels; each is written at once where the line is free.

    def drive(self, units: tuple[int, int, int, int]) -> None:
        """Say these wheel speeds, in the board's units, until others replace them."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            self._let_go = False
            self._writer.velocity(self._identity.dialect.speeds(units))

    def brake(self) -> None:
        """Command zero, before anything else that waits."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            self._let_go = False
            self._writer.stop((self._identity.dialect.brake,))

    def cut(self) -> None:
        """Let the motors go, before anything else; a dialect that cannot brakes instead."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            dialect = self._identity.dialect
            self._let_go = True
            self._writer.stop((dialect.cut or dialect.brake,))

    def release(self) -> None:
        """Say again and again that the motors are let go, until a speed replaces it."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            dialect = self._identity.dialect
            self._let_go = True
            self._writer.velocity(dialect.cut or dialect.brake)

    def rearm(self) -> None:
        """Tell the board again what it forgets at a reset, in case it was reset without a word."""
        if self._poller is not None and not self._leaving:
            self.counters["rearmed_unheard"] += 1
            self._poller.arm()

    @property
    def identity(self) -> Identity | None:
        """What the board is, once known."""
        return self._identity

    @property
    def port_name(self) -> str:
        """The port, by name; empty before it is open."""
        return "" if self._port is None else self._port.name

    @property
    def standing(self) -> bool:
        """Whether the counters show every wheel standing."""
        return self._watch.standing

    def facts(self) -> dict[str, int]:
        """Every counter of the link."""
        facts: Counter[str] = Counter(self.counters)
        if self._writer is not None:
            facts.update(self._writer.facts())
        if self._poller is not None:
            facts.update(self._poller.counters)
        facts.update(self._reception.facts())
        return dict(facts)

    async def run(self) -> None:
        """Open, connect, and serve until cancelled or until the link fails.

        Raises:
            LinkError: The port or the board is not to be had, or went away.
            BoardError: The board is not one that can be driven.
        """
        port = await self._opener()
        self._port = port
        self._gone = asyncio.get_running_loop().create_future()
        port.listen(self._data, self._lost)
        try:
            async with asyncio.TaskGroup() as tasks:
                self._vital.append(tasks.create_task(self._watch_port(), name="port-watch"))
                await self._connect(port, tasks)
                await self._watch_tasks()
        except BaseExceptionGroup as group:
            known, unknown = group.split(YahboomdError)
            if unknown is not None or known is None:
                raise
            error = _first(known)
            # What takes no bytes cannot be told to stop: the port is let go, and opened anew.
            self._port_lost = self._port_lost or isinstance(error, PortLost)
            raise error from None
        finally:
            await undisturbed(self._leave(port))

    async def _connect(self, port: Port, tasks: asyncio.TaskGroup) -> None:
        await stop_unidentified(port, self._clock)
        profile = self._options.profile
        heard: list[Decoded] = []
        found = await handshake.identify(
            port, self._clock, self._options.dialect, self._hear_raw, heard
        )
        dialect = found.for_profile(profile)
        writer = Writer(
            port,
            self._clock,
            resend_ns=nanoseconds(self._options.resend_s),
            spacing_ns=dialect.totals_spacing_ns,
        )
        # Known from here on: what comes is decoded, and a failure stops in the right dialect.
        self._identity = Identity(dialect=dialect, settings=None)
        self._reception.dialect = dialect
        self._writer = writer
        self._vital.append(tasks.create_task(writer.run(), name="link-writer"))
        poller = Poller(
            writer,
            self._clock,
            dialect,
            period_ns=nanoseconds(1.0 / self._options.poll_rate_hz),
            on_reading=self._listener.reading,
            port=port,
        )
        self._asking_settings = True
        try:
            settings = await handshake.read_settings(
                writer, dialect, profile.settings, port.name, heard
            )
        finally:
            self._asking_settings = False
        self._identity = Identity(dialect=dialect, settings=settings)
        self._poller = poller
        self._reception.gather(port)
        poller.arm()
        self._listener.connected(self, self._identity)
        self._vital.append(tasks.create_task(poller.run(), name="link-poller"))
        if dialect.battery is not None and self._options.battery_period_s > 0.0:
            tasks.create_task(self._ask_battery(writer, dialect.battery), name="link-battery")

    def _hear_raw(self, ears: Callable[[Frame | TextLine], None] | None) -> None:
        """Let somebody hear what comes before it is understood (to find out the dialect)."""
        self._reception.ears = ears

    async def _ask_battery(self, writer: Writer, frame: bytes) -> None:
        period_ns = nanoseconds(self._options.battery_period_s)
        while True:
            await writer.request(frame, lambda said: isinstance(said, Battery), BATTERY_ANSWER_S)
            await sleep_until(self._clock, self._clock.now_ns() + period_ns)

    async def _watch_tasks(self) -> None:
        """A task group lets a task be cancelled alone, and goes on without it. Not this one."""
        done, _ = await asyncio.wait(self._vital, return_when=asyncio.FIRST_COMPLETED)
        raise RuntimeError(f"the task {done.pop().get_name()} ended by itself")

    # What comes in.

    def _data(self, data: bytes) -> None:
        try:
            self._reception.take(data, self._clock.now_ns())
        except Exception as error:  # noqa: BLE001 - told to the session, which ends with it
            # Here the event loop is the caller: it would log the error, and drive on.
            self._end(error)

    def _understand(self, decoded: Decoded, item: Frame | TextLine, now_ns: int) -> None:
        assert self._port is not None
        if isinstance(decoded, Totals):
            byte_ns = self._port.byte_ns
            received_ns = now_ns - item.trailing * byte_ns
            sent_ns = received_ns - item.size * byte_ns
            requested_ns = earliest_ns = None
            # While the session ends, questions go past the writer, and it knows of none of them.
            if self._writer is not None and self._writer.poll_heard_ns and not self._leaving:
                # An answer cannot have left before the question was all there.
                requested_ns = min(self._writer.poll_heard_ns, received_ns)
                sent_ns = max(sent_ns, requested_ns)
                asked_ns = self._writer.answered_poll_ns()
                earliest_ns = requested_ns if asked_ns is None else min(asked_ns, requested_ns)
            if self._writer is not None:
                # Now that it is known which question this answers, the next one may go: the board
                # is at work while the counts are made use of here.
                self._writer.heard(decoded)
            self._watch.see(decoded.ticks, received_ns)
            if self._poller is not None:
                self._poller.reading(
                    decoded.ticks,
                    received_ns=received_ns,
                    sent_ns=sent_ns,
                    requested_ns=requested_ns,
                    earliest_ns=earliest_ns,
                )
            return
        if isinstance(decoded, Battery):
            self._listener.battery(decoded.volts)
        elif isinstance(decoded, VersionLine):
            if decoded.after_reset or not self._asking_settings:
                self._reset(decoded.version)
        elif isinstance(decoded, Unrecognised):
            self.counters["unrecognised"] += 1
        elif isinstance(decoded, Reply) and not decoded.ok:
            self.counters["refusals"] += 1
        if self._writer is not None:
            self._writer.heard(decoded)

    def _reset(self, version: str) -> None:
        self.counters["board_resets"] += 1
        self._watch.forget()
        if self._writer is not None:
            self._writer.quiet()
        if self._poller is not None:
            self._poller.board_reset()
            self._listener.board_reset(version)

    def _lost(self, error: Exception | None) -> None:
        assert self._port is not None
        self._port_lost = True
        self._end(lost(self._port.name, error))

    def _end(self, error: Exception) -> None:
        if self._gone is not None and not self._gone.done():
            self._gone.set_result(error)

    async def _watch_port(self) -> None:
        assert self._gone is not None
        raise await self._gone

    # The end.

    async def _leave(self, port: Port) -> None:
        """Stop the wheels and close. Bounded in time, whatever brought us here."""
        identity, self._leaving = self._identity, True
        self._reception.stop_gathering()
        if self._writer is not None:
            # A speed that waited for an answer would follow the stop.
            self._writer.close()
        try:
            if self._port_lost:
                return
            if identity is None:
                await stop_unidentified(port, self._clock)
                await port.drain(DRAIN_S)
            else:
                if self._poller is not None:
                    # At the loop's next turn, when the brake is on the wire already.
                    asyncio.get_running_loop().call_soon(self._listener.leaving)
                self.report = await bring_to_rest(
                    port, self._clock, identity.dialect, self._watch, let_go=self._let_go
                )
                if (doubt := self.report.doubt) is not None:
                    words = f"{port.name}: told the wheels to stop, and {doubt}. Look at them."
                    event = Event(kind="stop_not_seen", severity="error", message=words)
                    self._listener.event(event)
        finally:
            port.close()
            if self._gone is not None and not self._gone.done():
                self._gone.cancel()


def _first(group: BaseExceptionGroup[YahboomdError]) -> YahboomdError:
    """The error that ended the session; those of its siblings are its echoes."""
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    assert isinstance(error, YahboomdError)
    return error
