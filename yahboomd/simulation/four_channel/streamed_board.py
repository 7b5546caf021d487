"""The board that streams its counters: the vendor's firmware, 1.7.3 as observed.

Two things run on it. An interrupt every 10 ms counts and regulates (``speed_loop``); on other
firmware the totals may be renewed at another rate, or with every line. A main loop does one thing
at a time: carry out the command in the mailbox, answer it, or send the next stream
line; each of them blocks it until its last byte has left.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from yahboomd.core.clock import nanoseconds
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.board import BOOT_NS, NEVER, Emit
from yahboomd.simulation.four_channel.flash import (
    SETTINGS,
    FlashContent,
    SettingRefused,
    changed,
    confirmation,
    cut_short,
    report,
    short,
    tuning,
    whole,
)
from yahboomd.simulation.four_channel.mailbox import Mailbox
from yahboomd.simulation.motors import PWM_MAX
from yahboomd.simulation.options import SimulationOptions, StreamPace
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.speed_loop import SPEED_MAX, TICK_NS, MotorControl, beyond
from yahboomd.simulation.wire import transfer_ns

NOTICE_NS = 400_000
"""The time from the last byte of a command to its effect, when the main loop is idle."""

CARRY_OUT_NS = 200_000
"""The time for which a command without an answer occupies the main loop."""

STORE_NS = (65_000_000, 116_000_000)
STORE_GAINS_NS = (250_000_000, 350_000_000)
ERASE_NS = (600_000_000, 1_000_000_000)
OFF_NS = 50_000_000
"""How long the supply is gone where it fails within such an operation."""

DEAF_SHARE = 0.9
"""Share of a flash operation during which received bytes are lost."""

SPEED_LINE_NS = 60_000_000
LONG_LINE = 50
SPOILT_SHARE = 0.115
"""Commands lost while total lines of :data:`LONG_LINE` bytes and more are sent: 7 to 16 %."""

FATAL_NUMBERS = 14
"""The numbers in one command that overwrite what the MCU needs to go on."""

_NOT_FOUND = b"fail,Command not found!"

FIRMWARE = "1.7.3"
"""The version that is modelled here."""


class StreamedBoard:
    """The streamed dialect's board.

    Attributes:
        cut_writes: The supply fails within so many of the next writes of the flash.
        streams: Those that are on: totals, deltas, speeds.
    """

    def __init__(
        self, options: SimulationOptions, plant: Plant, emit: Emit, random: Random
    ) -> None:
        self.emit = emit
        flash = options.flash
        self.flash = flash if isinstance(flash, FlashContent) else FlashContent()
        self.version = options.firmware or FIRMWARE
        self._plant = plant
        self._control = MotorControl(plant, options.initial_ticks, options.loop_gain)
        self._mailbox = Mailbox()
        self._baud = options.baud
        self._pace: StreamPace = options.stream_pace
        self._random = random
        self._tuning = tuning(self.flash, self._plant.motor_type)
        self._tick_period_ns = nanoseconds(options.tick_period_s)
        self._tick_jitter_ns = nanoseconds(options.tick_jitter_s)
        self._tick_ns = NEVER
        self._renew_ns = NEVER
        self._main_ns = NEVER
        self._then: Callable[[int], None] | None = None
        self._idle = True
        self._listens_ns = 0
        self.streams = (False, False, False)
        self._speed_line_ns = 0
        self._long_lines = False
        self.cut_writes = 0
        self._commands: dict[bytes, Callable[[bytes, int], None]] = {
            b"spd:": self._spd,
            b"pwm:": self._pwm,
            b"upload:": self._upload,
            b"read_flash": lambda _args, now_ns: self._answer_raw(
                report(self.flash, self.version), now_ns
            ),
            b"read_vol": lambda _args, now_ns: self._answer(
                f"$Battery:{self._plant.volts:.1f}V#".encode(), now_ns
            ),
            b"flash_reset": self._flash_reset,
        }

    @property
    def next_ns(self) -> int:
        """The time of the next thing that happens inside."""
        return min(self._tick_ns, self._renew_ns, self._main_ns)

    @property
    def speaks_ns(self) -> int:
        """The time at which the main loop next does something."""
        return self._main_ns

    @property
    def totals(self) -> Counts:
        """The counters, as they were last renewed."""
        return self._control.totals

    def start(self, now_ns: int) -> None:
        """Start as a board that was powered long ago."""
        self._tick_ns = now_ns + TICK_NS
        self._listens_ns = now_ns
        self.set_tick_period(now_ns, self._tick_period_ns, self._tick_jitter_ns)

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:
        """Renew the totals every ``period_ns`` from now on, or with every line where that is 0."""
        self._tick_period_ns, self._tick_jitter_ns = period_ns, jitter_ns
        self._renew_ns = now_ns + period_ns if period_ns else NEVER

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:
        """Lose all but the flash and start again after ``off_ns``."""
        self._plant.advance(now_ns)
        self._control.restart()
        self._mailbox.reset()
        self.streams = (False, False, False)
        self._long_lines = False
        self._tuning = tuning(self.flash, self._plant.motor_type)
        awake_ns = now_ns + off_ns + BOOT_NS
        self._listens_ns = awake_ns
        self._tick_ns = awake_ns
        self._renew_ns = awake_ns if self._tick_period_ns else NEVER
        # A software reset cuts the line end of its last words: both arrive as one line.
        banner = f"Motor_Version:{self.version}\r\n".encode()
        self._occupy(awake_ns, then=lambda at_ns: self._say(banner, at_ns, then=self._resume))
        if not by_power:
            self.emit(b"Reset MCU", now_ns)

    def hang(self) -> None:
        """Stop executing, with the outputs as they are."""
        self._tick_ns = self._renew_ns = self._main_ns = self._listens_ns = NEVER

    def receive(self, byte: int, now_ns: int) -> None:
        """One byte has arrived; it is lost while the board writes flash or starts."""
        if now_ns < self._listens_ns or not self._mailbox.put(byte):
            return
        if self._long_lines and self._mailbox.ready and self._random.random() < SPOILT_SHARE:
            self._mailbox.spoil()
        if self._idle:
            self._main_ns = min(self._main_ns, now_ns + NOTICE_NS)

    def run_due(self, now_ns: int) -> None:
        """Do everything that is due up to ``now_ns``."""
        while True:
            if self._renew_ns <= self._tick_ns and self._renew_ns <= self._main_ns:
                if (at_ns := self._renew_ns) > now_ns:
                    return
                self._renew_ns += self._tick_period_ns
                if self._tick_jitter_ns:
                    self._renew_ns += self._random.randint(0, self._tick_jitter_ns)
                self._control.renew_totals(at_ns, self._tuning)
            elif self._tick_ns <= self._main_ns:
                if (at_ns := self._tick_ns) > now_ns:
                    return
                self._tick_ns += TICK_NS
                self._control.tick(at_ns, self._tuning)
            else:
                if (at_ns := self._main_ns) > now_ns:
                    return
                self._main(at_ns)

    # The main loop.

    def _main(self, now_ns: int) -> None:
        self._main_ns = NEVER
        self._idle = True
        if (then := self._then) is not None:
            self._then = None
            then(now_ns)
            if not self._idle or self._listens_ns == NEVER:
                return
        if self._mailbox.ready:
            self._execute(self._mailbox.take(), now_ns)
        elif self._mailbox.too_long:
            self._mailbox.too_long = False
            self._say(b"fail,command is long!\r\n", now_ns, then=self._resume)
        else:
            self._stream(now_ns)

    def _occupy(self, until_ns: int, *, then: Callable[[int], None]) -> None:
        self._main_ns = until_ns
        self._then = then
        self._idle = False

    def _say(self, data: bytes, now_ns: int, *, then: Callable[[int], None]) -> None:
        if data:
            self.emit(data, now_ns)
        self._occupy(now_ns + transfer_ns(len(data), self._baud), then=then)

    def _resume(self, _now_ns: int) -> None:
        """Continue the main loop after what occupied it."""

    def _done(self, _now_ns: int) -> None:
        # Whatever frame has ended since the command was taken is lost here.
        self._mailbox.wipe()

    def _answer(self, text: bytes, now_ns: int) -> None:
        self._answer_raw(text + b"\r\n", now_ns)

    def _answer_raw(self, data: bytes, now_ns: int) -> None:
        self._say(data, now_ns, then=self._done)

    def _stream(self, now_ns: int) -> None:
        totals, deltas, speeds = self.streams
        if speeds and now_ns >= self._speed_line_ns:
            self._speed_line_ns = max(self._speed_line_ns + SPEED_LINE_NS, now_ns)
            numbers = ",".join(f"{v:.2f}" for v in self._control.speeds_mm_s(self._tuning))
            self._line(f"$MSPD:{numbers}#\r\n", now_ns, then=self._resume)
        elif totals:
            if not self._tick_period_ns:
                self._control.renew_totals(now_ns, self._tuning)
            self._line(
                self._numbers("MAll", self._control.totals),
                now_ns,
                then=self._stream_deltas if deltas else self._resume,
            )
        elif deltas:
            self._stream_deltas(now_ns)
        elif speeds:
            self._main_ns = self._speed_line_ns

    def _stream_deltas(self, now_ns: int) -> None:
        self._line(self._numbers("MTEP", self._control.deltas), now_ns, then=self._resume)

    def _line(self, text: str, now_ns: int, *, then: Callable[[int], None]) -> None:
        self.emit(text.encode(), now_ns)
        if text.startswith("$MAll"):
            self._long_lines = len(text) >= LONG_LINE
        self._occupy(now_ns + line_period_ns(len(text), self._baud, self._pace), then=then)

    @staticmethod
    def _numbers(name: str, numbers: Counts) -> str:
        return "$%s:%d,%d,%d,%d#\r\n" % (name, *numbers)  # noqa: UP031 - on the hot path

    # The commands.

    def _execute(self, command: bytes, now_ns: int) -> None:
        name, colon, args = command.partition(b":")
        if colon and name in SETTINGS:
            self._set(name, args, now_ns)
        elif (carry_out := self._commands.get(name + colon)) is not None:
            carry_out(args, now_ns)
        else:
            self._answer(_NOT_FOUND, now_ns)

    def _motor_numbers(self, args: bytes, limit: int) -> tuple[int, ...] | None:
        """Four clamped numbers; None where there are so many that the MCU hangs."""
        parts = args.split(b",")
        if len(parts) >= FATAL_NUMBERS:
            self.hang()
            return None
        numbers = [short(whole(part)) for part in (parts + [b""] * CHANNELS)[:CHANNELS]]
        return tuple(max(-limit, min(limit, number)) for number in numbers)

    def _spd(self, args: bytes, now_ns: int) -> None:
        if (speeds := self._motor_numbers(args, SPEED_MAX)) is not None:
            self._control.regulate(speeds)
            self._occupy(now_ns + CARRY_OUT_NS, then=self._done)

    def _pwm(self, args: bytes, now_ns: int) -> None:
        if (outputs := self._motor_numbers(args, PWM_MAX)) is not None:
            self._plant.advance(now_ns)
            tuning = self._tuning
            above = tuple(beyond(output, tuning.dead_zone) for output in outputs)
            self._control.drive(above, inverted=tuning.inverted)
            self._occupy(now_ns + CARRY_OUT_NS, then=self._done)

    def _upload(self, args: bytes, now_ns: int) -> None:
        a, b, c = (whole(part) != 0 for part in (args.split(b",") + [b""] * 3)[:3])
        self.streams = (a, b, c)
        self._speed_line_ns = now_ns
        self._long_lines = self._long_lines and a
        self._occupy(now_ns + CARRY_OUT_NS, then=self._done)

    def _set(self, name: bytes, args: bytes, now_ns: int) -> None:
        content = changed(self.flash, name, args)
        if isinstance(content, SettingRefused):
            self._answer(content.answer, now_ns)
            return
        confirm = confirmation(name, self.version)

        def stored(at_ns: int) -> None:
            self.flash = content
            self._tuning = tuning(self.flash, self._plant.motor_type)
            self._answer_raw(confirm, at_ns)

        def stored_gains(at_ns: int) -> None:
            self.flash = content
            self.reset(at_ns, by_power=False)

        if content == self.flash:
            self._answer_raw(confirm, now_ns)
        elif name == b"MPID":
            self._write(STORE_GAINS_NS, content, now_ns, then=stored_gains)
        else:
            self._write(STORE_NS, content, now_ns, then=stored)

    def _flash_reset(self, _args: bytes, now_ns: int) -> None:
        def erased(at_ns: int) -> None:
            self.flash = FlashContent()
            self._say(
                b"falsh_reset:OK!\r\n",
                at_ns,
                then=lambda then_ns: self.reset(then_ns, by_power=False),
            )

        self._write(ERASE_NS, FlashContent(), now_ns, then=erased)

    def _write(
        self,
        between_ns: tuple[int, int],
        content: FlashContent,
        now_ns: int,
        *,
        then: Callable[[int], None],
    ) -> None:
        duration_ns = self._random.randint(*between_ns)
        if self.cut_writes:
            self.cut_writes -= 1
            written = self._random.randrange(len(FlashContent.__struct_fields__))
            duration_ns = duration_ns * (1 + written) // (1 + len(FlashContent.__struct_fields__))

            def lost(at_ns: int) -> None:
                self.flash = cut_short(content, written)
                self.reset(at_ns, off_ns=OFF_NS, by_power=True)

            then = lost
        self._listens_ns = now_ns + round(DEAF_SHARE * duration_ns)
        self._occupy(now_ns + duration_ns, then=then)


def line_period_ns(size: int, baud: int, pace: StreamPace) -> int:
    """The time from the start of a stream line to the next thing that the main loop does.

    The rates seen on boards (407 lines a second of 16 bytes, 169 of 32, 120 of 44, 92 of 56) fit
    0.2125 ms a byte less 0.95 ms at 115200 baud: about twice the transfer time.
    """
    wire_ns = transfer_ns(size, baud)
    if pace == "wire":
        return wire_ns
    return max(wire_ns, (212_500 * size - 950_000) * 115200 // baud)
