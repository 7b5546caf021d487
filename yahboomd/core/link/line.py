"""The line to a board: its input, the decoding of it, and the way the line is left.

Sessions and conversations use it. It cuts the port's chunks into frames, decodes the frames, and
hands the results on at once. It notices damage, restarts of the board and the loss of
the port; and however it ends, it stops the wheels and closes the port, bounded in time.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Sequence

import msgspec

from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.errors import PortLost
from yahboomd.core.link.outbox import Answers
from yahboomd.core.link.port import Port
from yahboomd.core.link.port_errors import lost
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.link.start_notices import Notice, StartNotices
from yahboomd.core.link.stopping import DRAIN_S, StopReport, bring_to_rest, stop_unidentified
from yahboomd.core.link.tap import NO_TAP, Tap, TappedPort
from yahboomd.core.link.vital_tasks import VitalTasks, undisturbed
from yahboomd.core.link.writer import Spacing, Writer
from yahboomd.core.model import Counts, EncoderReading, ImuReading
from yahboomd.core.protocol.dialect import (
    Decoded,
    Dialect,
    FramerCounters,
    Inertial,
    Item,
    Reply,
    Totals,
    Unrecognised,
)
from yahboomd.core.protocol.registry import DIALECTS, connect_spacing_ns
from yahboomd.core.standstill import STILL_TICKS_PER_S, CountedStandstill

NOISY_DAMAGES = 5
NOISY_NS = 10_000_000_000
"""A line that damaged this many received chunks in this time probably damages sent ones too. A
board that is reset cuts a line or two. A missing answer does not count: a busy computer causes
those."""

CUT_NS = 100_000_000
"""A line that was cut because the process did not read comes within this time, and is no damage."""

DAMAGES_MOST = 16
"""Damages of the last ten seconds are counted up to here."""

NOISY_RESEND_NS = 25_000_000
"""On a noisy line a speed is sent at this period: one that arrives garbled lives no longer."""

KEPT_BYTES = 512


class ReceivedSample(msgspec.Struct, kw_only=True):
    """A sample of the input, to explain a port without a board.

    Attributes:
        start: The first bytes, half a kilobyte at most.
        counters: The framer's counters of the whole input.
        resets: How often the board announced a restart, or may have.
    """

    start: bytes = b""
    counters: FramerCounters
    resets: int = 0


class Line:
    """A port and the board at its other end, whose dialect is known sooner or later.

    Args:
        still_ticks_per_s: Below it a wheel counts as standing.
        resend_s: The period at which the current velocity is repeated.

    Attributes:
        tasks: Those that the line cannot do without.
        dialect: The dialect of the board; None before that is known.
        writer: The outgoing half.
        watch: Sees whether the wheels stand.
        notices: Sees whether the board has started.
        unread: Items from before the dialect was known, with the dialect whose framer found them.
        news: Set when ``unread`` grows.
        said: The decoded items of ``unread``.
        ticks: The latest counters.
        streaming: Counts came, and no sign that the board has started since.
        report: The outcome of the stop, at the end or before.
        heard: A sample of the input.
        counters: The faults, by name.
        on_counts: Takes counts at their arrival.
        on_imu: Takes samples of the inertial sensor.
        on_said: Takes everything else, with its notice of a start of the board.
        on_leaving: Called when the line itself is stopping the wheels.
    """

    def __init__(
        self,
        port: Port,
        clock: Clock,
        *,
        still_ticks_per_s: float = STILL_TICKS_PER_S,
        resend_s: float = 1.0,
        tap: Tap = NO_TAP,
    ) -> None:
        self.port = port = port if tap is NO_TAP else TappedPort(port, tap)
        self.tap = tap
        self.clock = clock
        self._resend_ns = nanoseconds(resend_s)
        self._framers = {name: dialect.framer() for name, dialect in DIALECTS.items()}
        self._framer = next(iter(self._framers.values()))
        self._damage = 0
        self._damaged_ns: deque[int] = deque(maxlen=DAMAGES_MOST)
        self._cut_until_ns = 0
        self._lost = False
        self._leaving = False
        self._at_rest = False
        self._was_noisy = False
        self.dialect: Dialect | None = None
        self.tasks = VitalTasks()
        self.writer = Writer(
            port, clock, resend_ns=self._resend_ns, spacing=Spacing(frame_ns=connect_spacing_ns())
        )
        self.watch = CountedStandstill(still_ticks_per_s)
        self.notices = StartNotices()
        self.unread: list[tuple[str, Item]] = []
        self.news = asyncio.Event()
        self.said: list[Decoded] = []
        self.ticks: Counts | None = None
        self.streaming = False
        self._guard = PortGuard()
        self._let_go = False
        self.report: StopReport | None = None
        self.heard = ReceivedSample(counters=self._framer.counters)
        self.counters: Counter[str] = Counter()
        self.on_counts: Callable[[EncoderReading], None] = lambda _: None
        self.on_imu: Callable[[ImuReading], None] = lambda _: None
        self.on_said: Callable[[Decoded, Notice], None] = lambda *_: None
        self.on_leaving: Callable[[], None] = lambda: None
        tap.opened(port.name, port.byte_ns)

    # For sessions and conversations.

    @contextlib.asynccontextmanager
    async def attended(self, *, reopens: bool = False) -> AsyncIterator[None]:
        """Listen; in the end stop the wheels and close the port, however the body ended.

        The loss of the port, and the end of any task of the line, end the body.

        Args:
            reopens: A port that takes no output is opened again, which drops the held output: it
                is closed without waiting for a stop to get through.

        Raises:
            PortLost: The port went away.
        """
        self.port.listen(self._data, self._port_lost)
        try:
            async with self.tasks.running():
                self.tasks.start(self.tasks.failure(), "port-watch")
                yield
        except PortLost:
            self._lost = self._lost or reopens
            raise
        finally:
            await undisturbed(self._leave())

    def overhear(self) -> None:
        """Listen, and leave stop and port to the caller."""
        self.port.listen(self._data, lambda _: None)

    def understand(self, dialect: Dialect, *, spacing_ns: int) -> None:
        """Understand the board from now on, and write to it.

        Args:
            spacing_ns: From the last byte of a frame to the first of the next.
        """
        self.dialect = dialect
        self._framer = self._framers[dialect.name]
        self.heard.counters = self._framer.counters
        self.said = [dialect.decode(item) for name, item in self.unread if name == dialect.name]
        self.unread.clear()
        for decoded in self.said:
            self._note(decoded)
        self.writer.spacing = Spacing(
            frame_ns=spacing_ns,
            question_ns=dialect.question_spacing_ns,
            answer_ns=dialect.answer_spacing_ns,
        )
        self.tasks.start(self.writer.run(), "link-writer")

    def drop_input(self) -> None:
        """Drop old input after this process did not run; the kernel has dropped the rest."""
        self._cut_until_ns = self.clock.now_ns() + CUT_NS
        self.port.drop_input()

    async def share(self, guard: PortGuard, dialect: Dialect) -> bool:
        """Write no motion behind a stop of the guard; returns whether that has the port."""
        self._guard = guard
        self.writer.stopped = lambda: guard.stopped
        guard.let_go(self._let_go)
        return await guard.watches(dialect, self.clock)

    @property
    def let_go(self) -> bool:
        """Whether the motors are without power: leaving does not brake."""
        return self._let_go

    @let_go.setter
    def let_go(self, without_power: bool) -> None:
        self._let_go = without_power
        self._guard.let_go(without_power)

    async def ask(self, frame: bytes, answered: Answers, timeout_s: float) -> bool:
        """Send one frame and wait for its answer; return whether it came."""
        self._at_rest = False
        return await self.writer.request(frame, answered, timeout_s)

    async def rest(self, dialect: Dialect, *, leave: bool = True) -> StopReport:
        """Bring the wheels to rest and release the motors.

        If the brake is not obeyed the motors are cut, and watched while they coast.

        Args:
            leave: Streams are off afterwards; else the line stays in use.
        """
        # A frame that waited for an answer would follow the stop.
        self.writer.closed = True
        if not leave:
            # A cut that waits would delay the next command.
            self.writer.stop(())
        report = await bring_to_rest(
            self.port, self.clock, dialect, self.watch, let_go=self.let_go, leave=leave
        )
        self.writer.closed = self._leaving
        if leave:
            self.report, self._at_rest = report, True
        return report

    @property
    def lost(self) -> bool:
        return self._lost

    @property
    def damages(self) -> int:
        """The chunks that came damaged in the last ten seconds, up to 16."""
        damaged_ns, since_ns = self._damaged_ns, self.clock.now_ns() - NOISY_NS
        while damaged_ns and damaged_ns[0] <= since_ns:
            damaged_ns.popleft()
        return len(damaged_ns)

    @property
    def noisy(self) -> bool:
        """Whether the line damaged something lately, so that commands may not arrive as sent."""
        return self.damages >= NOISY_DAMAGES

    def status_values(self) -> dict[str, int]:
        framed = self._framer.counters
        found = {name: getattr(framed, name) for name in framed.__struct_fields__}
        return {**found, **self.counters, **self.writer.status_values()}

    # The input.

    def _data(self, data: bytes) -> None:
        try:
            self._receive(data)
        except Exception as error:  # noqa: BLE001 - raised by the tasks, which end with it
            # Here the event loop is the caller: it would log the error and continue.
            self.tasks.fail(error)

    def _receive(self, data: bytes) -> None:
        now_ns = self.clock.now_ns()
        items = self._take(data, now_ns)
        if self.dialect is None:
            return
        self._notice_noise(now_ns)
        # Behind a whole item, a framer that holds nothing is like a fresh one.
        if self.tap.due and items and not self._framer.held_bytes:
            self.tap.settled()

    def _take(self, data: bytes, now_ns: int) -> Sequence[Item]:
        """Cut and decode the input; return the items, if the dialect is known."""
        self.tap.received(data, now_ns)
        if len(self.heard.start) < KEPT_BYTES:
            self.heard.start = (self.heard.start + data)[:KEPT_BYTES]
        dialect = self.dialect
        if dialect is None:
            # The framers of all dialects cut the same bytes.
            for name, framer in self._framers.items():
                if items := framer.feed(data):
                    self.unread += [(name, item) for item in items]
                    self.news.set()
            return ()
        items = self._framer.feed(data)
        for item in items:
            decoded = dialect.decode(item)
            if isinstance(decoded, Totals):
                self._counts(decoded, item, now_ns)
            elif isinstance(decoded, Inertial):
                self._inertial(decoded, item, now_ns)
            else:
                self._words(decoded)
        return items

    def _counts(self, totals: Totals, item: Item, now_ns: int) -> None:
        self._guard.heard(now_ns)
        byte_ns = self.port.byte_ns
        received_ns = now_ns - item.trailing * byte_ns
        sent_ns = received_ns - item.size * byte_ns
        requested_ns = earliest_ns = None
        writer = self.writer
        # While the line is being left, questions bypass the writer, which knows none of them.
        if writer.poll_heard_ns and not self._leaving:
            # An answer cannot have left before the question was all there.
            requested_ns = min(writer.poll_heard_ns, received_ns)
            sent_ns = max(sent_ns, requested_ns)
            asked_ns = writer.answered_poll_ns()
            earliest_ns = requested_ns if asked_ns is None else min(asked_ns, requested_ns)
        # Now that the answered question is known, the next one may go: the board works on it
        # while the counts are used here.
        writer.receive(totals, received_ns)
        self.ticks, self.streaming = totals.ticks, True
        self.watch.add(totals.ticks, received_ns)
        self.on_counts(
            EncoderReading(
                ticks=totals.ticks,
                received_ns=received_ns,
                sent_ns=sent_ns,
                requested_ns=requested_ns,
                earliest_ns=earliest_ns,
            )
        )

    def _inertial(self, sample: Inertial, item: Item, now_ns: int) -> None:
        self.counters["imu_readings"] += 1
        self.on_imu(
            ImuReading(
                sensor=sample.sensor,
                sent_ns=now_ns - (item.trailing + item.size) * self.port.byte_ns,
                gyro_rad_s=sample.gyro_rad_s,
                acceleration_m_s2=sample.acceleration_m_s2,
                magnetic_t=sample.magnetic_t,
            )
        )

    def _words(self, decoded: Decoded) -> None:
        notice = self._note(decoded)
        if notice == "start":
            self.counters["board_resets"] += 1
            self.writer.quiet()
        elif isinstance(decoded, Unrecognised):
            self.counters["unrecognised"] += 1
        elif isinstance(decoded, Reply) and not decoded.ok:
            self.counters["refusals"] += 1
        self.on_said(decoded, notice)
        self.writer.receive(decoded)

    def _note(self, decoded: Decoded) -> Notice:
        """Note a start of the board, if this shows one: earlier readings prove nothing then."""
        if isinstance(decoded, Totals):
            self.streaming = True
            return "none"
        notice = self.notices.judge(decoded, self.clock.now_ns())
        if notice != "none":
            self.heard.resets += 1
            self.streaming = False
            self.watch.reset()
        return notice

    def _notice_noise(self, now_ns: int) -> None:
        seen = self._framer.counters
        framed = seen.broken_frames + seen.discarded_bytes + seen.overlong + seen.bad_bytes
        damage, self._damage = self._damage, framed + self.counters.get("unrecognised", 0)
        if damage != self._damage and now_ns >= self._cut_until_ns:
            self._damaged_ns.append(now_ns)
        elif not self._was_noisy:
            return
        if (noisy := self.noisy) != self._was_noisy:
            self._was_noisy = noisy
            resend_ns = min(self._resend_ns, NOISY_RESEND_NS) if noisy else self._resend_ns
            self.writer.set_resend(resend_ns)
            self.writer.resync = self.dialect.resync if noisy and self.dialect else b""

    # The end.

    def _port_lost(self, error: Exception | None) -> None:
        self._lost = True
        self.tasks.fail(lost(self.port.name, error))

    async def _leave(self) -> None:
        """Stop the wheels and close. Bounded in time, in every case."""
        self._leaving = self.writer.closed = True
        try:
            if self._lost or self._at_rest:
                return
            if self.dialect is None:
                await stop_unidentified(self.port, self.clock)
                await self.port.drain(DRAIN_S)
            else:
                # At the loop's next turn, when the brake is on the wire already.
                asyncio.get_running_loop().call_soon(self.on_leaving)
                await self.rest(self.dialect)
        finally:
            self.port.close()
            self.tap.closed()
