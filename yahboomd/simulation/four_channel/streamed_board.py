"""The board that streams its counters: the vendor's firmware, 1.7.3 as observed.

Two things run on it. An interrupt every 10 ms counts and regulates (``speed_loop``); on other
firmware the totals may be renewed at another rate, or with every line. A main loop does one thing
at a time: carry out the command in the mailbox, answer it, or send the next stream
line; each of them blocks it until its last byte has left.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from random import Random

import msgspec

from yahboomd.core.clock import nanoseconds
from yahboomd.core.model import CHANNELS, Counts
from yahboomd.simulation.board import NEVER, Emit
from yahboomd.simulation.four_channel.flash import (
    SETTINGS,
    FlashContent,
    SettingRefused,
    changed,
    confirmation,
    fields,
    is_erased,
    report,
    short,
    tuning,
    whole,
)
from yahboomd.simulation.four_channel.mailbox import Mailbox
from yahboomd.simulation.four_channel.page_write import PREPARE_NS, PageWrite
from yahboomd.simulation.four_channel.text_times import line_period_ns, printing_ns, saying_ns
from yahboomd.simulation.motors import PWM_MAX
from yahboomd.simulation.options import SimulationOptions, StreamPace
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.speed_loop import SPEED_MAX, TICK_NS, MotorControl, beyond
from yahboomd.simulation.wire import transfer_ns

NOTICE_NS = 30_000
"""The time from the last byte of a command to its effect, when the main loop is idle."""

CARRY_OUT_NS = 100_000
"""The time for which a command without an answer occupies the main loop."""

LOOPS_NS = 85_000
"""For so long an interrupt whose speed loops run holds up what fills the flash."""

START_NS = 2_300_000
"""The time from a reset to the banner; 2 ms of it, for the clocks' start, are assumed."""

GAINS = ("p", "i", "d")
FIELDS = {
    b"mtype": ("motor_type",),
    b"deadzone": ("dead_zone",),
    b"mline": ("lines",),
    b"mphase": ("ratio",),
    b"wdiameter": ("wheel_diameter_mm",),
}
"""The fields that each command stores. Gains act after a reset, the others at once."""

LAST_WORDS = b"\r\nReset MCU\r"
"""The reset cuts off the end of this line: the banner follows in the same line."""

OFF_NS = 50_000_000
"""The duration of a supply failure within a write."""

SPEED_LINE_TICKS = 6
VOLTS_TICKS = 21
MOST_VOLTS = 13.3
"""The greatest voltage reported; 0 is reported until the first measurement after a reset."""

LONG_LINE = 50
SPOILT_SHARE = 0.115
"""Commands lost while total lines of :data:`LONG_LINE` bytes and more are sent: 7 to 16 %."""

FULL_FRAME = 50
"""A frame of so many characters fills its memory: further ones are ignored, and the latest answer,
which lies behind it, is read on as its end."""

FATAL_NUMBERS = 14
"""This many numbers in a speed or output overwrite memory that the MCU needs: it hangs. On a line
that loses bytes, yahboomd's own frames merge into one that is so long."""

_NOT_FOUND = b"fail,Command not found!"

FIRMWARE = "1.7.3"
"""The version that is modelled here."""


class StreamedBoard:
    """The streamed dialect's board.

    Attributes:
        cut_writes: The number of flash writes, from the next one on, within which the supply fails.
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
        # When the next interrupt is due, and when it comes.
        self._timer_ns = NEVER
        self._tick_ns = NEVER
        self._renew_ns = NEVER
        self._main_ns = NEVER
        self._then: Callable[[int], None] | None = None
        self._idle = True
        self._listens_ns = 0
        self.streams = (False, False, False)
        self._ticks = 0
        self._speeds_due = False
        # A board that was powered long ago has measured it.
        self._volts_seen: float | None = None
        self._answered = b""
        self._long_lines = False
        self.cut_writes = 0
        self._write: PageWrite | None = None
        self._held_byte: int | None = None
        commands: dict[bytes, Callable[[bytes, int], None]] = {
            b"spd": self._spd,
            b"pwm": self._pwm,
            b"read_flash": self._report,
            b"read_vol": self._volts,
            b"flash_reset": self._flash_reset,
            **{name: partial(self._set, name) for name in SETTINGS},
        }
        # The firmware knows each name in lower and in upper case, ``upload`` in lower case only.
        self._commands = {
            spelt: carry_out
            for name, carry_out in commands.items()
            for spelt in (name.lower(), name.upper())
        }
        self._commands[b"upload"] = self._upload

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
        self._timer_ns = self._tick_ns = now_ns + TICK_NS
        self._listens_ns = now_ns
        self.set_tick_period(now_ns, self._tick_period_ns, self._tick_jitter_ns)

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:
        """Renew the totals every ``period_ns`` from now on, or with every line if it is 0."""
        self._tick_period_ns, self._tick_jitter_ns = period_ns, jitter_ns
        self._renew_ns = now_ns + period_ns if period_ns and not self._renews_at_ticks else NEVER

    @property
    def _renews_at_ticks(self) -> bool:
        return self._tick_period_ns == TICK_NS and not self._tick_jitter_ns

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:
        """Lose all but the flash and start again after ``off_ns``."""
        self._plant.advance(now_ns)
        self._control.restart()
        self._mailbox.reset()
        self.streams = (False, False, False)
        self._speeds_due = self._long_lines = False
        self._ticks = 0
        self._volts_seen = 0.0
        self._held_byte = None
        self._answered = b""
        if self._write is not None:
            self.flash = self._write.left(now_ns)
            self._write = None
        self._tuning = tuning(self.flash, self._plant.motor_type)
        said_ns = 0 if by_power else transfer_ns(len(LAST_WORDS), self._baud)
        awake_ns = now_ns + off_ns + said_ns + START_NS
        self._listens_ns = awake_ns
        self._timer_ns = self._tick_ns = awake_ns + TICK_NS
        self._renew_ns = NEVER if self._renew_ns == NEVER else awake_ns
        banner = f"Motor_Version:{self.version}\r\n".encode()

        def wake(at_ns: int) -> None:
            self._control.count_from_now(at_ns)
            self._say(banner, at_ns, then=self._resume)

        self._occupy(awake_ns, then=wake)
        if not by_power:
            self.emit(LAST_WORDS, now_ns)

    def hang(self) -> None:
        """Stop executing, with the outputs as they are."""
        self._tick_ns = self._renew_ns = self._main_ns = self._listens_ns = NEVER

    def receive(self, byte: int, now_ns: int) -> None:
        """One byte has arrived; it is lost while the board erases flash or starts."""
        if now_ns < self._listens_ns:
            return
        if self._write is not None and self._write.halts_until_ns(now_ns) > now_ns:
            # The receiver has room for one.
            if self._held_byte is None:
                self._held_byte = byte
            return
        self._take_held()
        self._take(byte, now_ns)

    def _take_held(self) -> None:
        if self._held_byte is not None:
            held, self._held_byte = self._held_byte, None
            self._mailbox.put(held)

    def _take(self, byte: int, now_ns: int) -> None:
        if not self._mailbox.put(byte):
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
                self._tick(at_ns)
            else:
                if (at_ns := self._main_ns) > now_ns:
                    return
                self._main(at_ns)

    def _tick(self, now_ns: int) -> None:
        # One interrupt can wait while the processor is halted; further ones are lost.
        self._timer_ns += TICK_NS * ((now_ns - self._timer_ns) // TICK_NS + 1)
        self._tick_ns = self._timer_ns
        self._hold_tick()
        self._control.tick(now_ns, self._tuning)
        if self._renews_at_ticks:
            self._control.renew_totals(now_ns, self._tuning)
        if self._write is not None and self._control.regulates and not self._tuning.frozen:
            self._write.filled_ns += LOOPS_NS
            self._main_ns += LOOPS_NS
        self._ticks += 1
        if self._ticks % SPEED_LINE_TICKS == 0:
            self._speeds_due = True
            if self._idle and self.streams[2]:
                self._main_ns = now_ns
        if self._ticks % VOLTS_TICKS == 0 or self._volts_seen is None:
            self._volts_seen = self._plant.volts

    def _hold_tick(self) -> None:
        if self._write is not None:
            self._tick_ns = self._write.halts_until_ns(self._tick_ns)

    # The main loop.

    def _main(self, now_ns: int) -> None:
        self._main_ns = NEVER
        self._idle = True
        noticed_ns = now_ns
        if (then := self._then) is not None:
            self._then = None
            then(now_ns)
            if not self._idle or self._listens_ns == NEVER:
                return
            noticed_ns += NOTICE_NS
        if self._mailbox.ready:
            self._execute(self._mailbox.take(), noticed_ns)
        elif self._mailbox.too_long:
            self._mailbox.too_long = False
            self._say(b"fail,command is long!\r\n", noticed_ns, then=self._resume)
        else:
            self._stream(now_ns)

    def _occupy(self, until_ns: int, *, then: Callable[[int], None]) -> None:
        self._main_ns = until_ns
        self._then = then
        self._idle = False

    def _say(self, data: bytes, now_ns: int, *, then: Callable[[int], None]) -> None:
        if data:
            self.emit(data, now_ns)
        self._occupy(now_ns + saying_ns(len(data), self._baud, self._pace), then=then)

    def _resume(self, _now_ns: int) -> None:
        """Continue the main loop; nothing else is left to do."""

    def _done(self, _now_ns: int) -> None:
        # A frame that has ended since the command was taken is lost here.
        self._mailbox.wipe()

    def _answer(self, text: bytes, now_ns: int) -> None:
        self._answered = text + b"\r\n"
        self._say(self._answered, now_ns, then=self._done)

    def _stream(self, now_ns: int) -> None:
        totals, deltas, _ = self.streams
        if totals:
            if not self._tick_period_ns:
                self._control.renew_totals(now_ns, self._tuning)
            self._line(
                self._numbers("MAll", self._control.totals), now_ns, then=self._stream_deltas
            )
        elif deltas:
            self._stream_deltas(now_ns)
        else:
            self._stream_speeds(now_ns)

    def _stream_deltas(self, now_ns: int) -> None:
        if self.streams[1]:
            self._line(
                self._numbers("MTEP", self._control.deltas), now_ns, then=self._stream_speeds
            )
        else:
            self._stream_speeds(now_ns)

    def _stream_speeds(self, now_ns: int) -> None:
        if self.streams[2] and self._speeds_due:
            self._speeds_due = False
            numbers = ",".join(f"{v:.2f}" for v in self._control.speeds_mm_s(self._tuning))
            self._line(f"$MSPD:{numbers}#\r\n", now_ns, then=self._resume)

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
        if len(command) >= FULL_FRAME:
            command = command[:FULL_FRAME] + self._answered
        for name, carry_out in self._commands.items():
            if command.startswith(name):
                # The firmware skips the character after the name, and ends the rest at a NUL.
                carry_out(command[len(name) + 1 :].partition(b"\0")[0], now_ns)
                return
        self._answer(_NOT_FOUND, now_ns)

    def _motor_numbers(self, args: bytes, limit: int) -> tuple[int, ...]:
        """Four clamped numbers."""
        numbers = [short(whole(field)) for field in (fields(args) + [b""] * CHANNELS)[:CHANNELS]]
        return tuple(max(-limit, min(limit, number)) for number in numbers)

    def _carried_out(self, args: bytes, now_ns: int) -> None:
        if len(fields(args)) >= FATAL_NUMBERS:
            self.hang()
        else:
            self._occupy(now_ns + CARRY_OUT_NS, then=self._done)

    def _spd(self, args: bytes, now_ns: int) -> None:
        self._control.regulate(self._motor_numbers(args, SPEED_MAX))
        self._carried_out(args, now_ns)

    def _pwm(self, args: bytes, now_ns: int) -> None:
        self._plant.advance(now_ns)
        tuning = self._tuning
        outputs = self._motor_numbers(args, PWM_MAX)
        above = tuple(beyond(output, tuning.dead_zone) for output in outputs)
        self._control.drive(above, inverted=tuning.inverted)
        self._carried_out(args, now_ns)

    def _upload(self, args: bytes, now_ns: int) -> None:
        # The firmware ignores the characters between the three digits.
        a, b, c = (args[place : place + 1] == b"1" for place in (0, 2, 4))
        self.streams = (a, b, c)
        self._long_lines = self._long_lines and a
        self._occupy(now_ns + CARRY_OUT_NS, then=self._done)

    def _report(self, _args: bytes, now_ns: int) -> None:
        first, version, *numbers = report(self.flash, self.version).splitlines(keepends=True)
        lines = [(first, 0), (version, 0), *((line, printing_ns(line)) for line in numbers)]

        self._answered = first

        def say(at_ns: int) -> None:
            line, delay_ns = lines.pop(0)
            self._say(line, at_ns + delay_ns, then=say if lines else self._done)

        say(now_ns)

    def _volts(self, _args: bytes, now_ns: int) -> None:
        volts = self._plant.volts if self._volts_seen is None else self._volts_seen
        text = f"$Battery:{min(MOST_VOLTS, volts):.1f}V#".encode()
        self._answer(text, now_ns + printing_ns(text))

    def _set(self, name: bytes, args: bytes, now_ns: int) -> None:
        content = changed(self.flash, name, args)
        if isinstance(content, SettingRefused):
            self._answer(content.answer, now_ns)
        elif content == self.flash:
            self._confirm(name, now_ns)
        elif name == b"MPID":
            self._store(GAINS, content, now_ns, then=self._restart)
        else:
            self._tuning = tuning(content, self._plant.motor_type)
            self._store(
                FIELDS[name],
                content,
                now_ns,
                then=partial(self._confirm, name),
            )

    def _confirm(self, name: bytes, now_ns: int) -> None:
        self._answered = confirmation(name, self.version)
        self._say(self._answered, now_ns, then=self._done)

    def _flash_reset(self, _args: bytes, now_ns: int) -> None:
        def erased(at_ns: int) -> None:
            self._say(b"falsh_reset:OK!\r\n", at_ns, then=self._restart)

        self._store(FlashContent.__struct_fields__, FlashContent(), now_ns, then=erased)

    def _restart(self, now_ns: int) -> None:
        self.reset(now_ns, by_power=False)

    def _store(
        self,
        names: tuple[str, ...],
        content: FlashContent,
        now_ns: int,
        *,
        then: Callable[[int], None],
    ) -> None:
        """Store values one by one, and write the page again for each."""
        fails = self._random.randrange(len(names)) if self.cut_writes else NEVER
        self.cut_writes = max(0, self.cut_writes - 1)

        def write(index: int, at_ns: int) -> None:
            self._take_held()
            self._write = None
            if index == len(names):
                then(at_ns)
                return
            before = self.flash
            value = {names[index]: getattr(content, names[index])}
            self.flash = msgspec.structs.replace(before, **value)
            if is_erased(before, names[index]):
                self._occupy(at_ns + PREPARE_NS, then=partial(write, index + 1))
                return
            self._write = page = PageWrite(before, self.flash, at_ns, self._random)
            self._hold_tick()
            if index == fails:
                self._occupy(page.some_moment_ns(self._random), then=self._lose_power)
            else:
                self._occupy(page.filled_ns, then=partial(write, index + 1))

        write(0, now_ns)

    def _lose_power(self, now_ns: int) -> None:
        self.reset(now_ns, off_ns=OFF_NS, by_power=True)
