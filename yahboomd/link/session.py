"""One connection to a board, from opening the port to letting it go.

The session owns the stream. In one task group run the writer, the poller and the watch on the port;
when one dies, so does the session, and its ``finally`` stops the wheels itself, bounded in time.
It never reconnects: the supervisor does.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import Awaitable, Callable
from typing import Protocol

import msgspec

from yahboomd.clock import Clock, nanoseconds, sleep_until
from yahboomd.errors import PortLost, YahboomdError
from yahboomd.link import handshake, latency_timer
from yahboomd.link.handshake import Identity
from yahboomd.link.outbox import Lane
from yahboomd.link.poller import Poller
from yahboomd.link.port import Port
from yahboomd.link.port_errors import lost, takes_no_output
from yahboomd.link.reception import Ears, Reception
from yahboomd.link.standstill import StandstillWatch
from yahboomd.link.start_notices import Notice, StartNotices
from yahboomd.link.stopping import (
    DRAIN_S,
    StopReport,
    bring_to_rest,
    stop_unidentified,
    undisturbed,
)
from yahboomd.link.writer import Writer
from yahboomd.model import NS_PER_S, EncoderReading, Event
from yahboomd.protocol.dialect import (
    Battery,
    Decoded,
    Item,
    Reply,
    Totals,
    Units,
    Unrecognised,
    VersionLine,
)
from yahboomd.protocol.profiles import PROFILES, MotorProfile

SETTINGS_LATEST_NS = 1_000_000_000
"""Until so long after the settings are read, answers to questions that were said twice may come."""

STILL: Units = (0, 0, 0, 0)

NOISY_DAMAGES = 5
NOISY_NS = 10_000_000_000
"""A line that damaged so many chunks in so long damages others. A board that was reset cuts a line
or two; and a question without an answer is no damage, since a busy computer has such, too."""

DAMAGES_MOST = 16
"""Damages of the last ten seconds are counted up to here."""

NOISY_RESEND_NS = 25_000_000
"""On such a line a speed is said so often: one that arrives garbled lives no longer."""

BATTERY_ANSWER_S = 0.3
BATTERY_SELDOM_S = 120.0
"""A board that does not answer is asked at least so often."""
BATTERY_UNANSWERED = 3
"""After so many questions in a row without an answer a person should know."""


class SessionOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How a session behaves.

    Attributes:
        dialect: ``auto``, or the only one to accept.
        poll_rate_hz: Polls per second of a board that is polled.
        resend_s: How often the current velocity is said again.
        still_ticks_per_s: Below it a wheel counts as standing.
        profile: The motors; a board that stores no type is sent it at each start.
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

    def armed(self) -> None:
        """The board was asked to stream its counts; until then a reset may go unnoticed."""
        ...

    def reading(self, reading: EncoderReading) -> None:
        """Counts arrived."""
        ...

    def sent(self, units: Units | None) -> None:
        """These speeds were written to the port just now; ``None``: the motors were let go."""
        ...

    def battery(self, volts: float) -> None:
        """The voltage of the motors' supply."""
        ...

    def board_reset(self, version: str) -> None:
        """The board restarted by itself: its motors are free, its counters at zero."""
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
        self._notices = StartNotices()
        self._settings_read_ns: int | None = None
        self._leaving = False
        self._let_go = False
        self._damage = 0
        self._damaged_ns: deque[int] = deque(maxlen=DAMAGES_MOST)
        self._velocity_units: Units | None = None
        self._stop_units: Units | None = None
        self._volts_heard = False
        self._stream_ran = False
        self._turning = False
        self._drove = False
        self.counters: Counter[str] = Counter()
        self.report: StopReport | None = None

    # Commands to the wheels; each is written at once where the line is free.

    def drive(self, units: Units) -> None:
        """Say these wheel speeds, in the board's units, until others replace them."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            self._let_go = False
            self._velocity_units = units
            self._writer.velocity(self._identity.dialect.speeds(units))

    def brake(self) -> None:
        """Command zero, before anything else that waits."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            self._let_go = False
            self._stop_units = STILL
            self._writer.stop((self._identity.dialect.brake,))

    def cut(self) -> None:
        """Let the motors go, before anything else; a dialect that cannot brakes instead."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            dialect = self._identity.dialect
            self._let_go = True
            self._stop_units = None
            self._writer.stop((dialect.cut or dialect.brake,))

    def release(self) -> None:
        """Say again and again that the motors are let go, until a speed replaces it."""
        if self._writer is not None and self._identity is not None and not self._leaving:
            dialect = self._identity.dialect
            self._let_go = True
            self._velocity_units = None
            self._writer.velocity(dialect.cut or dialect.brake)

    def _sent(self, lane: Lane) -> None:
        if lane in {Lane.VELOCITY, Lane.STOP}:
            units = self._velocity_units if lane is Lane.VELOCITY else self._stop_units
            self._turning = units is not None and any(units)
            self._drove = self._drove or self._turning
            self._listener.sent(units)

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

    @property
    def left_standing(self) -> bool | None:
        """Whether the wheels were seen to stand when the session ended; ``None`` if unconcerned.

        A port that was lost says nothing afterwards: what counts then is what was seen before.
        """
        if self.report is not None:
            return self.report.doubt is None
        return (self._watch.standing and not self._turning) if self._drove else None

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
            # A port that takes no bytes cannot carry a stop: it is closed, and opened again.
            self._port_lost = self._port_lost or isinstance(error, PortLost)
            raise error from None
        finally:
            await undisturbed(self._leave(port))

    async def _connect(self, port: Port, tasks: asyncio.TaskGroup) -> None:
        if not await stop_unidentified(port, self._clock):
            raise takes_no_output(port.name)
        profile = self._options.profile
        found = await handshake.identify(port, self._clock, self._options.dialect, self._hear_raw)
        dialect = found.for_profile(profile)
        writer = Writer(
            port,
            self._clock,
            resend_ns=nanoseconds(self._options.resend_s),
            spacing_ns=dialect.totals_spacing_ns,
            on_sent=self._sent,
            on_slow=lambda bytes_per_s: self._port_is_slow(port, bytes_per_s),
        )
        # Known from here on: what comes is decoded, and a failure stops in the right dialect.
        self._identity = Identity(dialect=dialect, settings=None)
        heard = self._reception.choose(dialect)
        self._writer = writer
        self._vital.append(tasks.create_task(writer.run(), name="link-writer"))
        poller = Poller(
            writer,
            self._clock,
            dialect,
            period_ns=nanoseconds(1.0 / self._options.poll_rate_hz),
            on_reading=self._listener.reading,
            on_armed=self._listener.armed,
            port=port,
        )
        for decoded in heard:
            self._note_stream(decoded)
        settings = await handshake.read_settings(
            writer, dialect, profile.settings, port.name, heard
        )
        self._settings_read_ns = self._clock.now_ns()
        self._identity = Identity(dialect=dialect, settings=settings)
        # A stream that needs no arming proves nothing: a reset does not end it.
        poller.unbroken = self._stream_ran and dialect.poll is None and bool(dialect.arm)
        self._poller = poller
        self._reception.gather(port)
        poller.arm()
        self._listener.connected(self, self._identity)
        if (words := latency_timer.describe(port.name)) is not None:
            self._listener.event(
                Event(
                    kind="latency_timer", severity="warning", message=" ".join(words.splitlines())
                )
            )
        self._vital.append(tasks.create_task(poller.run(), name="link-poller"))
        if dialect.battery is not None and self._options.battery_period_s > 0.0:
            tasks.create_task(self._ask_battery(writer, dialect.battery), name="link-battery")

    def _port_is_slow(self, port: Port, bytes_per_s: float) -> None:
        full = NS_PER_S // port.byte_ns
        words = (
            f"{port.name}: the port sends {bytes_per_s:.0f} bytes/s of {full}. Commands and stops "
            "reach the board late; yahboomd queues one frame at most. Look at the USB cable, the "
            "hub and the load of the machine."
        )
        self._listener.event(
            Event(
                kind="port_slow",
                severity="warning",
                message=words,
                data={"bytes_per_s": round(bytes_per_s)},
            )
        )

    def _hear_raw(self, ears: Ears | None) -> None:
        """Let somebody hear what comes before it is understood (to find out the dialect)."""
        self._reception.ears = ears

    async def _ask_battery(self, writer: Writer, frame: bytes) -> None:
        """Ask for the voltage; less and less often while no answer comes."""
        period_s = wait_s = self._options.battery_period_s
        unanswered = 0
        self._volts_heard = False
        while True:
            await writer.request(frame, lambda said: isinstance(said, Battery), BATTERY_ANSWER_S)
            await sleep_until(self._clock, self._clock.now_ns() + nanoseconds(wait_s))
            # An answer that came late is one as well.
            if self._volts_heard:
                self._volts_heard, unanswered, wait_s = False, 0, period_s
                continue
            self.counters["battery_unanswered"] += 1
            unanswered += 1
            wait_s = max(period_s, min(2.0 * wait_s, BATTERY_SELDOM_S))
            if unanswered == BATTERY_UNANSWERED:
                self._listener.event(_no_voltage(self.port_name))

    async def _watch_tasks(self) -> None:
        """A task group lets a task be cancelled alone, and goes on without it. Not this one."""
        done, _ = await asyncio.wait(self._vital, return_when=asyncio.FIRST_COMPLETED)
        raise RuntimeError(f"the task {done.pop().get_name()} ended by itself")

    # What comes in.

    def _data(self, data: bytes) -> None:
        try:
            now_ns = self._clock.now_ns()
            self._reception.take(data, now_ns)
            self._look_for_noise(now_ns)
        except Exception as error:  # noqa: BLE001 - raised in the session, which ends with it
            # Here the event loop is the caller: it would log the error, and drive on.
            self._end(error)

    def _look_for_noise(self, now_ns: int) -> None:
        """What a line damages now and then, it damages in the other direction as well."""
        if self._writer is None:
            return
        damage = self._reception.damage + self.counters["unrecognised"]
        was = self.noisy
        if damage != self._damage:
            self._damage = damage
            self._damaged_ns.append(now_ns)
        if was != (noisy := self.noisy):
            resend_ns = nanoseconds(self._options.resend_s)
            self._writer.set_resend(min(resend_ns, NOISY_RESEND_NS) if noisy else resend_ns)

    @property
    def noisy(self) -> bool:
        """Whether the line damaged something lately, so that commands may not arrive as sent."""
        return self.damages >= NOISY_DAMAGES

    @property
    def damages(self) -> int:
        """How many chunks the line damaged in the last ten seconds, up to 16."""
        damaged_ns, since_ns = self._damaged_ns, self._clock.now_ns() - NOISY_NS
        while damaged_ns and damaged_ns[0] <= since_ns:
            damaged_ns.popleft()
        return len(damaged_ns)

    def _understand(self, decoded: Decoded, item: Item, now_ns: int) -> None:
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
            if self._poller is None:
                self._stream_ran = True
            else:
                self._poller.reading(
                    decoded.ticks,
                    received_ns=received_ns,
                    sent_ns=sent_ns,
                    requested_ns=requested_ns,
                    earliest_ns=earliest_ns,
                )
            return
        notice = self._note_stream(decoded)
        if isinstance(decoded, Battery):
            self._volts_heard = True
            self._listener.battery(decoded.volts)
        elif isinstance(decoded, VersionLine):
            if notice == "start" or (notice == "unclear" and not self._may_answer(now_ns)):
                self._reset(decoded.version)
            elif self._poller is not None:
                self.counters["settings_late"] += 1
        elif isinstance(decoded, Unrecognised):
            self.counters["unrecognised"] += 1
        elif isinstance(decoded, Reply) and not decoded.ok:
            self.counters["refusals"] += 1
        if self._writer is not None:
            self._writer.heard(decoded)

    def _note_stream(self, decoded: Decoded) -> Notice:
        """Whether a stream was on before this session switched it on, and what may have ended it.

        Returns:
            What the line says of a start of the board.
        """
        notice = self._notices.judge(decoded)
        if isinstance(decoded, Totals):
            self._stream_ran = True
        elif notice != "none":
            self._stream_ran = False
            if self._poller is not None:
                self._poller.unbroken = False
        return notice

    def _may_answer(self, now_ns: int) -> bool:
        """Whether a version may be a part of the settings, asked for while connecting.

        A banner that is taken for one is not missed: the stream that it ended is armed again after
        a silence, and the counters show where they started from.
        """
        read_ns = self._settings_read_ns
        return read_ns is None or now_ns - read_ns <= SETTINGS_LATEST_NS

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
                    words = f"{port.name}: a stop was sent, and {doubt}. Look at the wheels."
                    event = Event(kind="stop_not_seen", severity="error", message=words)
                    self._listener.event(event)
        finally:
            port.close()
            if self._gone is not None and not self._gone.done():
                self._gone.cancel()


def _no_voltage(port: str) -> Event:
    """The board does not tell its supply voltage."""
    words = (
        f"{port}: the board left {BATTERY_UNANSWERED} questions for the battery voltage in a row "
        "unanswered. The voltage is unknown; yahboomd asks less often, down to once in "
        f"{BATTERY_SELDOM_S:.0f} s. Where the board has no voltage to tell, set "
        "board.battery_period_s = 0."
    )
    return Event(
        kind="battery_unanswered", severity="warning", message=" ".join(words.splitlines())
    )


def _first(group: BaseExceptionGroup[YahboomdError]) -> YahboomdError:
    """The error that ended the session; those of its siblings are its echoes."""
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    assert isinstance(error, YahboomdError)
    return error
