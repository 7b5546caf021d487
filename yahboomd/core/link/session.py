"""One connection to a board, from opening the port to closing it.

The session opens the port and identifies the board. Then the writer, the poller and the watch on
the port run; when one dies, so does the session, and its line stops the wheels itself, bounded in
time. It never reconnects: the supervisor does.
"""

from __future__ import annotations

from collections import Counter

import msgspec

from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.link import handshake, latency_timer
from yahboomd.core.link.connected_board import ConnectedBoard, Listener
from yahboomd.core.link.handshake import Identity
from yahboomd.core.link.line import Line
from yahboomd.core.link.poller import Poller
from yahboomd.core.link.port import Opener, Port
from yahboomd.core.link.port_errors import other_readers
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.link.stopping import StopReport
from yahboomd.core.link.tap import NO_TAP, Tap
from yahboomd.core.model import NS_PER_S, Event
from yahboomd.core.protocol.profiles import PROFILES, MotorProfile
from yahboomd.core.standstill import STILL_TICKS_PER_S


class SessionOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a session.

    Attributes:
        dialect: ``auto``, or the only one to accept.
        poll_rate_hz: Polls per second of a board that has to be asked.
        resend_s: The period at which the current velocity is repeated.
        still_ticks_per_s: Below it a wheel counts as standing.
        profile: The motors; a board that stores no type is sent it at each start.
        battery_period_s: The period of requests for the voltage, if the dialect can; 0 for never.
    """

    dialect: str = "auto"
    poll_rate_hz: float = 50.0
    resend_s: float = 0.1
    still_ticks_per_s: float = STILL_TICKS_PER_S
    profile: MotorProfile = PROFILES["520"]
    battery_period_s: float = 5.0


class Session:
    """One connection. ``run`` is called once.

    Args:
        guard: Stops the wheels if this process cannot; the opener shares the port with it.

    Attributes:
        board: The board, once connected.
    """

    def __init__(
        self,
        opener: Opener,
        clock: Clock,
        listener: Listener,
        options: SessionOptions,
        tap: Tap = NO_TAP,
        *,
        guard: PortGuard | None = None,
    ) -> None:
        self._opener = opener
        self._tap = tap
        self._guard = guard
        self._clock = clock
        self._listener = listener
        self._options = options
        self._line: Line | None = None
        self.board: ConnectedBoard | None = None

    async def run(self) -> None:
        """Open, connect, and serve until cancelled or until the link fails.

        Raises:
            LinkError: The port or the board is not available, or went away.
            BoardError: The board is not one that can be driven.
        """
        options, port = self._options, await self._opener()
        line = self._line = Line(
            port,
            self._clock,
            still_ticks_per_s=options.still_ticks_per_s,
            resend_s=options.resend_s,
            tap=self._tap,
        )
        line.writer.on_slow = lambda bytes_per_s: self._port_is_slow(port, bytes_per_s)
        try:
            async with line.attended(reopens=True):
                self.board = await self._connect(line)
                await line.tasks.failure()
        finally:
            if line.report is not None and line.report.doubt is not None:
                words = (
                    f"{port.name}: a stop was sent, and {line.report.doubt}. Look at the wheels."
                )
                event = Event(kind="stop_not_seen", severity="error", message=words)
                self._listener.event(event)

    @property
    def port_name(self) -> str:
        return "" if self._line is None else self._line.port.name

    @property
    def recognised(self) -> bool:
        return self._line is not None and self._line.dialect is not None

    @property
    def report(self) -> StopReport | None:
        """The outcome of the stop at the end; ``None`` if no stop was possible."""
        return None if self._line is None else self._line.report

    @property
    def left_standing(self) -> bool | None:
        """Whether the wheels were seen to stand when the session ended; ``None`` if unconcerned.

        A lost port reports nothing afterwards: then the last observation counts.
        """
        if self.report is not None:
            return self.report.doubt is None
        return None if self.board is None else self.board.seen_standing

    def status_values(self) -> dict[str, int]:
        facts: Counter[str] = Counter()
        for part in (self._line, self.board):
            if part is not None:
                facts.update(part.status_values())
        return dict(facts)

    async def _connect(self, line: Line) -> ConnectedBoard:
        options, listener = self._options, self._listener
        found = await handshake.identify(line, options.dialect)
        dialect = found.for_profile(options.profile)
        line.understand(dialect, spacing_ns=dialect.totals_spacing_ns)
        if self._guard is not None:
            await line.share(self._guard, dialect)
        await handshake.await_reports(line, dialect)
        settings = await handshake.read_settings(line, dialect, options.profile.settings)
        identity = Identity(dialect=dialect, settings=settings)
        period_ns = nanoseconds(1.0 / options.poll_rate_hz)
        poller = Poller(
            line.writer,
            self._clock,
            dialect,
            period_ns=period_ns,
            on_reading=listener.reading,
            on_armed=listener.armed,
            port_name=line.port.name,
            # Reports that come unasked prove nothing: they continue after a reset.
            unbroken=line.streaming and dialect.poll is None and not dialect.listen_ns,
            tap=self._tap,
        )
        board = ConnectedBoard(line, identity, listener, poller)
        poller.arm()
        self._tap.identified(dialect.name, settings)
        listener.connected(board, identity)
        if words := latency_timer.describe(line.port.name):
            words = " ".join(words.splitlines())
            listener.event(Event(kind="latency_timer", severity="warning", message=words))
        if words := other_readers(line.port.name):
            listener.event(Event(kind="port_shared", severity="warning", message=words))
        line.tasks.start(poller.run(), "link-poller")
        if dialect.battery is not None and options.battery_period_s > 0.0:
            asking = board.ask_battery(dialect.battery, options.battery_period_s)
            line.tasks.start(asking, "link-battery")
        return board

    def _port_is_slow(self, port: Port, bytes_per_s: float) -> None:
        full = NS_PER_S // port.byte_ns
        words = (
            f"{port.name}: the port sends {bytes_per_s:.0f} bytes/s of {full}. Commands and stops "
            "reach the board late; yahboomd queues one frame at most. Look at the USB cable, the "
            "hub and the load of the machine."
        )
        rate = round(bytes_per_s)
        event = Event(
            kind="port_slow", severity="warning", message=words, data={"bytes_per_s": rate}
        )
        self._listener.event(event)
