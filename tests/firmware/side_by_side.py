"""The simulated four-channel board beside the vendor's firmware: the same bytes, the same motors.

The firmware drives the motors. The simulated board counts what they turn and says what it would
give them, so that a small difference stays one. Both get the same random commands at the same
moments, in blocks; after each the wheels come to rest, and both report what they have stored.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import pairwise
from random import Random
from typing import Any, TypeAlias

import msgspec
from random_commands import Step
from vendor_firmware import MOTORS, FirmwareStreamed

from yahboomd.core.model import CHANNELS, NS_PER_S, Counts
from yahboomd.simulation.board import NEVER
from yahboomd.simulation.four_channel.flash import FlashContent, fields, mm_s_per_tick
from yahboomd.simulation.four_channel.page_write import PREPARE_NS
from yahboomd.simulation.four_channel.streamed_board import StreamedBoard
from yahboomd.simulation.options import PLAIN_GAIN, SimulationOptions
from yahboomd.simulation.plant import SAG_V, Plant
from yahboomd.simulation.speed_loop import SPEED_MAX, TICK_NS
from yahboomd.simulation.wire import Wire, transfer_ns

MS = 1_000_000
BAUD = 115200

RACE_NS = 150_000
"""Interrupts and the printing of numbers move the firmware's moments by so much."""

LATE_NS = 5 * MS
"""How far apart answers may begin and end: numbers take the firmware a while to print, and each
interrupt holds up what writes the flash."""

PASS_NS = 25 * MS
"""The longest pass of the main loop through all streams, whose phase is any."""

PHASE_NS = 100_000
"""How far apart the interrupts of both may come at the begin of a block."""

STREAM = re.compile(r"\$(MAll|MTEP|MSPD):(-?[\d.]+),(-?[\d.]+),(-?[\d.]+),(-?[\d.]+)#\r\n")
BATTERY = re.compile(r"\$Battery:(\d+\.\d)V#\r\n")
BANNER = "Motor_Version:1.7.3\r\n"
MISSED = 3
"""Counts that come while the firmware reads its timers. After a reset the emulator's timers, which
go on, show up to a tick's counts more."""

LONGEST_NS = 20_000 * MS
"""The end of a block in which a board hangs with its wheels turning."""

LACKING_NUMBERS = 2
"""With at most this many numbers in a speed or output, the firmware takes the others from its
memory, or hangs. yahboomd always sends four, and the simulated board takes zeros."""
LACKING_GAINS = 1
"""The same of gains, of which yahboomd always sends three."""

MANY_NUMBERS = 11
"""From so many numbers on, a command leaves the places of some where the firmware looks for those
that later commands lack."""

NOT_COUNTED = 4
"""With this type the counts after a reset are added only when another type is stored."""

FEW = 20
"""Lines of streams: those of the epilogue."""

EPILOGUE = (
    Step(40 * MS, b"\n" * 64, settled=True),
    Step(40 * MS, b"$upload:0,0,0#"),
    Step(40 * MS, b"$pwm:0,0,0,0#"),
    Step(40 * MS, b"$read_flash#"),
)
LAST = (
    Step(40 * MS, b"$upload:1,0,0#"),
    Step(12 * MS, b"$upload:0,0,0#"),
    Step(40 * MS, b""),
)
"""Stop, ask for what is stored, and for the counters once the wheels are at rest."""


class Typical(Random):
    """Flash takes as long as it usually does, as in the emulator."""

    def triangular(self, low: float = 0.0, high: float = 1.0, mode: float | None = None) -> float:
        return (low + high) / 2.0 if mode is None else mode


class Onlooker:
    """The motors as the simulated board has them: it counts, and its outputs are only noted."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.motor_type = plant.motor_type
        self.outputs: tuple[int, ...] = (0,) * CHANNELS

    @property
    def ticks(self) -> Counts:
        return self._plant.ticks

    @property
    def volts(self) -> float:
        return self._plant.volts

    def advance(self, now_ns: int) -> None:
        """Do nothing: the firmware's board turns them."""

    def set_outputs(self, pwm: tuple[int, ...]) -> None:
        self.outputs = pwm


class Watched(StreamedBoard):
    """The simulated board, and the moments at which it looks into its mailbox.

    Attributes:
        ended_ns: When a frame ended.
        wiped: When a command was done, and whatever frame had ended meanwhile was lost, with the
            number of frames that had ended when the command was taken.
        near_calls: Writes that began so near an interrupt that either may have been the first, and
            failures of the supply while values were written, and bytes that came when the processor
            was just halted or went on.
        near_speeds: Speeds that came so near an interrupt.
        late_speed: Whether one did since the last sample.
        lacking: Speeds and outputs with too few numbers, while lines stream, or behind
            :data:`MANY_NUMBERS`; and too few gains, while lines stream.
    """

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.ended_ns: list[int] = []
        self.wiped: list[tuple[int, int]] = []
        self._taken = 0
        self.near_calls = self.near_speeds = self.lacking = 0
        self.late_speed = self._had_many = False

    @property
    def next_tick_ns(self) -> int:
        return self._tick_ns

    @next_tick_ns.setter
    def next_tick_ns(self, tick_ns: int) -> None:
        self._timer_ns = self._tick_ns = tick_ns

    @property
    def hangs(self) -> bool:
        return self._tick_ns == NEVER

    @property
    def writes(self) -> bool:
        """Whether it writes its flash."""
        return self._write is not None

    def receive(self, byte: int, now_ns: int) -> None:
        self.run_due(now_ns)
        if byte == ord("#"):
            self.ended_ns.append(now_ns)
        if (page := self._write) is not None:
            edges = (abs(now_ns - edge_ns) for edge_ns in (page.begin_ns, page.erased_ns))
            self.near_calls += min(edges) < RACE_NS
        super().receive(byte, now_ns)

    def _execute(self, command: bytes, now_ns: int) -> None:
        self._taken = len(self.ended_ns)
        super()._execute(command, now_ns)

    def _done(self, now_ns: int) -> None:
        self.wiped.append((now_ns, self._taken))
        super()._done(now_ns)

    def _spd(self, args: bytes, now_ns: int) -> None:
        since_ns = (now_ns - self._tick_ns) % TICK_NS
        if min(since_ns, TICK_NS - since_ns) < 2 * RACE_NS:
            self.near_speeds += 1
            self.late_speed = True
        super()._spd(args, now_ns)

    def _carried_out(self, args: bytes, now_ns: int) -> None:
        numbers = len(fields(args))
        self.lacking += numbers <= LACKING_NUMBERS and (any(self.streams) or self._had_many)
        self._had_many = self._had_many or numbers >= MANY_NUMBERS
        super()._carried_out(args, now_ns)

    def _set(self, name: bytes, args: bytes, now_ns: int) -> None:
        if name == b"MPID":
            gains = len(fields(args))
            self.lacking += gains <= LACKING_GAINS and any(self.streams)
            self._had_many = self._had_many or gains >= MANY_NUMBERS
        super()._set(name, args, now_ns)

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:
        # Values are written one by one within four milliseconds.
        page = self._write
        self._had_many = False
        self.near_calls += page is not None and -2 * MS < now_ns - page.erased_ns < 5 * MS
        super().reset(now_ns, off_ns=off_ns, by_power=by_power)

    def _store(self, *args: Any, **kwargs: Any) -> None:
        now_ns = args[2]
        self.near_calls += abs(self._tick_ns - now_ns - PREPARE_NS) < 2 * RACE_NS
        super()._store(*args, **kwargs)

    def close_calls(self, frames: int, pass_ns: int) -> int:
        """The frames that ended so near such a moment that either may have been the first.

        Args:
            frames: The first so many of them.
            pass_ns: Frames that are nearer to each other than this are such, too.
        """
        ended_ns = self.ended_ns[:frames]
        return (
            self.near_calls
            + sum(
                any(
                    number >= taken and abs(end_ns - wiped_ns) < RACE_NS
                    for wiped_ns, taken in self.wiped
                )
                for number, end_ns in enumerate(ended_ns)
            )
            + sum(later - earlier < pass_ns for earlier, later in pairwise(ended_ns))
        )


class Sample(msgspec.Struct, frozen=True):
    """What the boards give the motors in the middle between two interrupts.

    Attributes:
        flash: What the simulated board has stored.
        regulates: Whether its speed loops run.
        writes: Whether it writes its flash.
        late_speed: Whether a speed came near or between the last interrupts of both.
    """

    firmware: tuple[int, ...]
    simulated: tuple[int, ...]
    flash: FlashContent
    regulates: bool
    writes: bool
    late_speed: bool


class Text(msgspec.Struct, frozen=True):
    """A line that was heard, with the arrival of its first byte and of its last."""

    text: str
    first_ns: int
    last_ns: int

    def __str__(self) -> str:
        return f"{self.first_ns / MS:.1f} {self.text!r}"


class Ear:
    """What a board says."""

    def __init__(self) -> None:
        self.wire = Wire(BAUD)
        self._bytes: list[tuple[int, int]] = []

    def listen(self, now_ns: int) -> None:
        self._bytes += [(at_ns, byte) for byte, at_ns in self.wire.take_each(now_ns)]

    def take(self, since_ns: int) -> list[Text]:
        """The lines since the last call."""
        found: list[Text] = []
        line = bytearray()
        first_ns = 0
        for at_ns, byte in self._bytes:
            first_ns = first_ns if line else at_ns
            line.append(byte)
            if byte == ord("\n"):
                found.append(Text(line.decode("latin-1"), first_ns - since_ns, at_ns - since_ns))
                line.clear()
        if line:
            found.append(Text(line.decode("latin-1"), first_ns - since_ns, at_ns - since_ns))
        self._bytes.clear()
        return found


class Difference(msgspec.Struct, frozen=True):
    """A difference between the two boards, and what both heard."""

    what: str
    firmware: str
    simulated: str
    steps: list[Step]

    def __str__(self) -> str:
        heard = "".join(f"\n    {step.pause_ns / MS:6.1f} ms, {step.data!r}" for step in self.steps)
        return f"{self.what}\n  firmware: {self.firmware}\n  simulated: {self.simulated}{heard}"


Parting: TypeAlias = tuple[str, str, str]
"""What differs, on the firmware and on the simulated board."""


class Comparison:
    """A pair of boards, and what was found on them.

    Attributes:
        counted: What was compared, and how much of it was equal.
        differences: What was not alike.

    Args:
        seed: Of the motors.
        counted: What was counted on other pairs.
    """

    def __init__(self, seed: int, counted: Counter[str] | None = None) -> None:
        random = Random(seed)
        motor_type = random.choice((1, 1, 2, 3))
        self._options = SimulationOptions(
            drive="skid_steer",
            motor_type=motor_type,
            battery_volts=12.0,
            rated_volts=12.0,
            loop_gain=PLAIN_GAIN,
            flash=FlashContent(motor_type=motor_type),
            seed=seed,
            **random.choice(list(MOTORS.values())),
        )
        self.counted: Counter[str] = Counter() if counted is None else counted
        self.differences: list[Difference] = []
        self._ears = Ear(), Ear()
        self._plant = Plant(self._options, random)
        self._firmware = FirmwareStreamed(
            self._options, self._plant, self._ears[0].wire.send, random
        )
        self._now_ns = self._sample_ns = self._phase_ns = 0
        self._again = False
        self._samples: list[Sample] = []
        self._kind = ""
        self._apart = [0] * CHANNELS
        self._coasted_ns = 0
        self._plant.start(0)
        self._firmware.start(0)
        self._onlooker = Onlooker(self._plant)
        self._simulated = Watched(
            self._options, self._onlooker, self._ears[1].wire.send, Typical(seed)
        )
        self._simulated.start(0)
        self._align()

    def play(self, kind: str, steps: list[Step]) -> None:
        """Have both boards hear the same, then come to rest, and compare what they did."""
        self._kind = kind
        start_ns = self._align()
        self._hear(steps)
        frames = len(self._simulated.ended_ns)
        self._hear(EPILOGUE)
        while not all(motor.at_rest for motor in self._plant.motors):
            if self._now_ns - start_ns > LONGEST_NS:
                break
            self._run(self._now_ns + 20 * MS)
        self._hear(LAST)
        self.counted["commands"] += len(steps)
        self.counted[f"commands, {kind}"] += len(steps)
        texts = [ear.take(start_ns) for ear in self._ears]
        streams = _stream(texts[0])
        if self._simulated.close_calls(frames, PASS_NS if streams else 0):
            self.counted["blocks that a close call left unjudged"] += 1
            self._start_over()
            return
        hung = kind == "streams" and self._simulated.hangs
        found = (
            []
            if hung
            else [
                Difference(f"{kind}: {what}", *each, steps) for what, *each in self._judged(*texts)
            ]
        )
        if hung or (found and self._simulated.lacking):
            # The firmware takes what its memory has, or hangs, too.
            self.counted["blocks with too few numbers, not judged"] += 1
            self._start_over()
            return
        self.differences += found
        if found:
            self._start_over()
        elif not any(STREAM.fullmatch(text.text) for text in texts[0][-1:]):
            self.counted["hung boards"] += 1
            self._start_over()

    def _hear(self, steps: Iterable[Step]) -> None:
        for step in steps:
            self._run(self._now_ns + step.pause_ns)
            if step.settled and self._simulated.writes:
                while self._simulated.writes:
                    self._run(self._now_ns + 5 * MS)
                self._run(self._now_ns + 15 * MS)
            self._send(step.data)
            if step.power_fails:
                self._fail_power()

    # Both boards on one time.

    def _align(self) -> int:
        """Begin a block 3 ms after an interrupt; return its begin."""
        apart_ns = self._firmware.next_tick_ns - self._simulated.next_tick_ns
        if abs((apart_ns + TICK_NS // 2) % TICK_NS - TICK_NS // 2) > PHASE_NS:
            self._simulated.next_tick_ns = self._firmware.next_tick_ns
        begin_ns = self._firmware.next_tick_ns + 3 * MS
        self._sample_ns = self._phase_ns = begin_ns + 2 * MS
        self._again = False
        self._run(begin_ns)
        for ear in self._ears:
            ear.take(0)
        self._samples.clear()
        self._simulated.ended_ns.clear()
        self._simulated.wiped.clear()
        self._simulated.near_calls = self._simulated.near_speeds = self._simulated.lacking = 0
        self._simulated.late_speed = False
        return begin_ns

    def _start_over(self) -> None:
        """Have both store the same again, and count from 0."""
        self._fail_power()
        self._run(self._now_ns + 100 * MS)
        self._send(b"$flash_reset#")
        self._run(self._now_ns + 1000 * MS)
        self._apart = [0] * CHANNELS
        self._coasted_ns = 0

    def _fail_power(self) -> None:
        self._firmware.reset(self._now_ns, by_power=True)
        self._simulated.reset(self._now_ns, by_power=True)
        self._ears[1].wire.cut(self._now_ns)

    def _run_firmware(self, until_ns: int) -> None:
        self._firmware.run_due(until_ns)
        self._plant.advance(until_ns)
        self._ears[0].listen(until_ns)
        self._now_ns = until_ns

    def _run(self, until_ns: int) -> None:
        """Let time pass, from interrupt to interrupt, and sample between them."""
        while self._now_ns < until_ns:
            tick_ns = self._simulated.next_tick_ns
            stop_ns = min(until_ns, self._sample_ns)
            if self._now_ns < tick_ns < stop_ns:
                stop_ns = tick_ns
            self._run_firmware(stop_ns)
            self._simulated.run_due(stop_ns)
            self._ears[1].listen(stop_ns)
            if stop_ns == self._sample_ns:
                given = tuple(motor.pwm for motor in self._plant.motors)
                board = self._simulated
                # A command that comes with a sample may act on one of both only behind it.
                self._again = given != self._onlooker.outputs and not self._again
                if self._again:
                    self._sample_ns += RACE_NS
                    continue
                self._sample_ns += TICK_NS - (self._sample_ns - self._phase_ns) % TICK_NS
                self._samples.append(
                    Sample(
                        given,
                        self._onlooker.outputs,
                        board.flash,
                        board._control.regulates,
                        board.writes,
                        board.late_speed,
                    )
                )
                board.late_speed = False

    def _send(self, data: bytes) -> None:
        start_ns = self._now_ns
        for number, byte in enumerate(data, 1):
            self._run(start_ns + transfer_ns(number, BAUD))
            self._firmware.receive(byte, self._now_ns)
            self._simulated.receive(byte, self._now_ns)

    # What is compared.

    def _judged(self, firmware: list[Text], simulated: list[Text]) -> Iterator[Parting]:
        lines = [
            [text for text in texts if STREAM.fullmatch(text.text)]
            for texts in (firmware, simulated)
        ]
        streams = _stream(firmware)
        said = [
            [text for text in texts if not STREAM.fullmatch(text.text)]
            for texts in (firmware, simulated)
        ]
        if parting := _texts_differ(*said, PASS_NS if streams else LATE_NS):
            yield parting
            return
        for name in ("MAll", "MTEP", "MSPD"):
            one, other = (sum(name in text.text for text in texts) for texts in lines)
            self.counted[f"lines of {name}"] += one
            if abs(one - other) > 4 + 0.05 * one:
                yield f"lines of {name}", str(one), str(other)
        # A hung board reports none.
        if lines[0] or lines[1]:
            reset = any(text.text.endswith(BANNER) for text in said[0])
            if parting := self._counters_differ(*lines, reset=reset, streams=streams):
                yield parting
        for wheel in range(CHANNELS):
            if parting := self._outputs_differ(wheel, 2 if streams else 1):
                yield parting
                return

    def _counters_differ(
        self, one: list[Text], other: list[Text], *, reset: bool, streams: bool
    ) -> Parting | None:
        """Compare what the counters at rest have gained since the last block."""
        totals = [STREAM.fullmatch(lines[-1].text) for lines in (one, other) if lines]
        if len(totals) != 2 or totals[0] is None or totals[1] is None:
            return "counters", str(one[-1:]), str(other[-1:])
        apart = [int(totals[0][place]) - int(totals[1][place]) for place in range(2, 6)]
        if reset:
            # While lines stream it may come a pass of the main loop earlier or later.
            self._coasted_ns = TICK_NS + (PASS_NS if streams else 0)
        before, self._apart = [0] * CHANNELS if self._coasted_ns else self._apart, apart
        law = self._plant.motors[0].law
        coasted = law.max_speed_m_s * law.ticks_per_metre * self._coasted_ns / NS_PER_S
        most = max(float(MISSED), coasted)
        if self._simulated.flash.motor_type != NOT_COUNTED:
            self._coasted_ns = 0
        if max(abs(new - old) for new, old in zip(apart, before, strict=True)) <= most:
            return None
        return "counters", f"{totals[0][0]!r}, {before} more before", repr(totals[1][0])

    def _outputs_differ(self, wheel: int, shift: int) -> Parting | None:
        """Compare a wheel's outputs, which may come so many interrupts earlier or later."""
        one = [sample.firmware[wheel] for sample in self._samples]
        other = [sample.simulated[wheel] for sample in self._samples]
        held_up = False
        # An interrupt more or less adds to the output or not.
        writes = any(sample.writes for sample in self._samples)
        ticks = 1 if shift > 1 or self._simulated.near_speeds or writes else 0
        for k in range(shift, len(one) - shift):
            self.counted["outputs"] += 1
            # A write holds interrupts up: one finds as many counts more as it is late, and some
            # are lost, which shows until the loops start over. Within streams it may begin a whole
            # pass later, and as many are lost as happens.
            held_up = self._samples[k + 1].writes or (held_up and self._samples[k].regulates)
            if one[k] == other[k]:
                self.counted["outputs that are equal"] += 1
                continue
            if any(
                _alike(output, other[k], sample, counts=3 if shift == 1 else 10, ticks=ticks)
                for output in one[k - shift : k + shift + 1]
                for sample in self._samples[max(0, k - 5) : k + 2]
            ):
                continue
            if self._kind == "close" and one[k - 1] == other[k - 1] and one[k + 1] == other[k + 1]:
                # A frame that the next one replaces within two milliseconds gives its output until
                # the next interrupt, or not at all.
                self.counted["outputs between two close frames that are not alike"] += 1
                continue
            if self._samples[k].late_speed:
                # It acts an interrupt later on one of both.
                self.counted["outputs of a speed within an interrupt that are not alike"] += 1
                continue
            self.counted["outputs after a write that are not alike"] += held_up
            if not held_up:
                around = slice(max(0, k - 5), k + 6)
                return f"output {wheel} at {k}", str(one[around]), str(other[around])
        return None


def _stream(texts: list[Text]) -> bool:
    """Whether lines streamed, apart from those of the last question."""
    lines = [text.text for text in texts if STREAM.fullmatch(text.text)]
    return len(lines) > FEW or any("$MAll" not in line for line in lines)


def _texts_differ(one: list[Text], other: list[Text], late_ns: int) -> Parting | None:
    one, other = _as_cut(one, other), _as_cut(other, one)
    for a, b in zip(one, other, strict=False):
        late = max(abs(a.first_ns - b.first_ns), abs(a.last_ns - b.last_ns)) > late_ns
        if late or not (a.text == b.text or _volts_alike(a.text, b.text) or _cut_alike(a, b)):
            break
    else:
        if len(one) == len(other):
            return None
    return "answers", ", ".join(map(str, one)), ", ".join(map(str, other))


def _volts_alike(one: str, other: str) -> bool:
    """Whether both are the supply, under the load of moments 0.2 s apart at most."""
    volts = [float(found[1]) for text in (one, other) if (found := BATTERY.fullmatch(text))]
    return len(volts) == 2 and abs(volts[0] - volts[1]) < 0.1 + CHANNELS * SAG_V + 0.001


def _as_cut(texts: list[Text], others: list[Text]) -> list[Text]:
    """The texts, with the banner in the line before it where the other board's line was cut.

    What cut it there came behind the last byte here.
    """
    for place, (line, banner, other) in enumerate(zip(texts, texts[1:], others, strict=False)):
        cut = other.text != BANNER and other.text.endswith(BANNER)
        if cut and banner.text == BANNER and not line.text.endswith(BANNER):
            whole = Text(line.text + BANNER, line.first_ns, banner.last_ns)
            return [*texts[:place], whole, *texts[place + 2 :]]
    return texts


def _cut_alike(one: Text, other: Text) -> bool:
    """Whether both are a line that was cut at one moment: the later one lacks that time's bytes."""
    earlier, later = sorted((one, other), key=lambda text: text.first_ns)
    long, short = (text.text.removesuffix(BANNER) for text in (earlier, later))
    late_ns = later.first_ns - earlier.first_ns
    return (
        all(text.text.endswith(BANNER) for text in (one, other))
        and 0 < len(short) < len(long)
        and long.startswith(short)
        and transfer_ns(len(long) - len(short) - 1, BAUD) < late_ns
    )


def _alike(one: int, other: int, sample: Sample, *, counts: int, ticks: int) -> bool:
    if not sample.regulates:
        return one == other
    flash = sample.flash
    a, b = (_own(each, flash.dead_zone) for each in (one, other))
    count = mm_s_per_tick(flash) * (flash.p + flash.i + 2.0 * flash.d)
    missed = ticks * flash.i * SPEED_MAX
    return abs(a - b) <= 2.0 + counts * count + missed + 0.02 * max(abs(a), abs(b))


def _own(output: int, dead_zone: int) -> int:
    """The output of the speed loop itself."""
    return 0 if output == 0 else (abs(output) - dead_zone) * (1 if output > 0 else -1)
