"""A board that is known and armed: its commands, and its answers."""

from __future__ import annotations

from collections import Counter
from typing import Protocol

from yahboomd.core.clock import nanoseconds, sleep_until
from yahboomd.core.link.handshake import Identity
from yahboomd.core.link.line import Line
from yahboomd.core.link.outbox import FrameLane
from yahboomd.core.link.poller import Poller
from yahboomd.core.link.start_notices import Notice
from yahboomd.core.model import EncoderReading, Event, ImuReading
from yahboomd.core.protocol.dialect import Battery, Decoded, Units, VersionLine

STILL: Units = (0, 0, 0, 0)

BATTERY_ANSWER_S = 0.3
BATTERY_SELDOM_S = 120.0
"""A board that does not answer is asked at least this often."""
BATTERY_UNANSWERED = 3
"""After this many questions in a row without an answer, a person should know."""


class Listener(Protocol):
    """Callbacks of a session: called on the loop, at arrival; they must not block."""

    def connected(self, board: ConnectedBoard, identity: Identity) -> None:
        """The board is known and armed; counts follow."""

    def armed(self) -> None:
        """The board was asked to stream its counts; a reset before it may go unnoticed."""

    def reading(self, reading: EncoderReading) -> None:
        """Counts arrived."""

    def imu(self, reading: ImuReading) -> None:
        """The inertial sensor was read."""

    def sent(self, units: Units | None) -> None:
        """Note the speeds that were just written to the port; ``None`` for a release."""

    def battery(self, volts: float) -> None:
        """The voltage of the motors' supply."""

    def board_reset(self, version: str) -> None:
        """The board restarted by itself: its motors are free, its counters at zero."""

    def event(self, event: Event) -> None:
        """Something a person may have to know."""

    def leaving(self) -> None:
        """The session ends, and stops the wheels by itself: no command reaches them any more."""


class ConnectedBoard:
    """Commands to the wheels, each written at once if the line is free."""

    def __init__(self, line: Line, identity: Identity, listener: Listener, poller: Poller) -> None:
        self._line = line
        self._dialect = identity.dialect
        self._listener = listener
        self._poller = poller
        self._volts_heard = True
        self._velocity_units: Units | None = None
        self._stop_units: Units | None = None
        self._turning = False
        self._drove = False
        self.identity = identity
        self.counters: Counter[str] = Counter()
        line.writer.on_sent = self._sent
        line.on_counts = poller.reading
        line.on_imu = listener.imu
        line.on_said = self._said
        line.on_leaving = listener.leaving

    def drive(self, units: Units) -> None:
        """Send these wheel speeds, in the board's units, until others replace them."""
        self._line.let_go = False
        self._velocity_units = units
        self._line.writer.velocity(self._dialect.speeds(units))

    def brake(self) -> None:
        self._line.let_go = False
        self._stop_units = STILL
        self._line.writer.stop((self._dialect.brake,))

    def cut(self) -> None:
        """Release the motors before anything else; a dialect without a cut brakes instead."""
        self._line.let_go = True
        self._stop_units = None
        self._line.writer.stop((self._dialect.cut or self._dialect.brake,))

    def release(self) -> None:
        """Send the release of the motors repeatedly, until a speed replaces it."""
        self._line.let_go = True
        self._velocity_units = None
        self._line.writer.velocity(self._dialect.cut or self._dialect.brake)

    @property
    def cuts(self) -> bool:
        return self._dialect.cut is not None

    def rearm(self) -> None:
        """Send the board again the frames whose effect a reset loses, in case of a silent reset."""
        self.counters["rearmed_unheard"] += 1
        self._poller.arm()

    def drop_input(self) -> None:
        self._line.drop_input()

    @property
    def stop_sent(self) -> bool:
        """Whether the last command for the wheels is a stop, and no part of it waits here."""
        line = self._line
        # Bytes for a port that is gone go nowhere, and none of them wait.
        return not (line.lost or line.writer.stopping or self._turning or line.port.queued())

    @property
    def port_name(self) -> str:
        return self._line.port.name

    @property
    def noisy(self) -> bool:
        """Whether the line damaged something lately, so that commands may not arrive as sent."""
        return self._line.noisy

    @property
    def damages(self) -> int:
        """The chunks that the line damaged in the last ten seconds, up to 16."""
        return self._line.damages

    @property
    def seen_standing(self) -> bool | None:
        """Whether the wheels were seen to stand last; ``None`` if they were not driven."""
        return (self._line.watch.standing and not self._turning) if self._drove else None

    def status_values(self) -> dict[str, int]:
        return {**self.counters, **self._poller.counters}

    async def ask_battery(self, frame: bytes, period_s: float) -> None:
        """Ask for the voltage until cancelled; less and less often while no answer comes."""
        clock, wait_s, unanswered = self._line.clock, period_s, 0
        self._volts_heard = False
        while True:
            await self._line.writer.request(frame, _is_battery, BATTERY_ANSWER_S)
            await sleep_until(clock, clock.now_ns() + nanoseconds(wait_s))
            # A late answer counts as well.
            if self._volts_heard:
                self._volts_heard, unanswered, wait_s = False, 0, period_s
                continue
            self.counters["battery_unanswered"] += 1
            unanswered += 1
            wait_s = max(period_s, min(2.0 * wait_s, BATTERY_SELDOM_S))
            if unanswered == BATTERY_UNANSWERED:
                self._listener.event(_no_voltage(self.port_name))

    def _sent(self, lane: FrameLane) -> None:
        if lane in {FrameLane.VELOCITY, FrameLane.STOP}:
            units = self._velocity_units if lane is FrameLane.VELOCITY else self._stop_units
            self._turning = units is not None and any(units)
            self._drove = self._drove or self._turning
            self._listener.sent(units)

    def _said(self, decoded: Decoded, notice: Notice) -> None:
        if notice != "none":
            self._poller.may_have_been_reset()
        if isinstance(decoded, Battery):
            # A board that reports it unasked does so all the time: once in a period is enough.
            if not self._volts_heard:
                self._volts_heard = True
                self._listener.battery(decoded.volts)
        elif isinstance(decoded, VersionLine):
            if notice == "start":
                self._poller.board_reset()
                self._listener.board_reset(decoded.version)
            else:
                self.counters["settings_late"] += 1


def _is_battery(said: Decoded) -> bool:
    return isinstance(said, Battery)


def _no_voltage(port: str) -> Event:
    words = (
        f"{port}: the board left {BATTERY_UNANSWERED} questions for the battery voltage in a row "
        "unanswered. The voltage is unknown; yahboomd asks less often, down to once in "
        f"{BATTERY_SELDOM_S:.0f} s. If the board reports no voltage, set "
        "board.battery_period_s = 0."
    )
    return Event(kind="battery_unanswered", severity="warning", message=words)
