"""False alarms of healthy wheels, and times to the cut of broken ones, on virtual time.

    make alarms MINUTES=60 SEED=1
    make alarms SEED=1 ARGS='--first 37 --pieces 1 --words'
    make alarms SEED=1 ARGS='--piece 0 --pieces 500'
    make alarms MINUTES=60 SEED=1 STICKS=1.3 FRICTION_SCALES=0.95,1.05
    make alarms MINUTES=60 SEED=1 ARGS='--dialects rosmaster --volts 9.7 12.6'

Drives a simulated robot at random, in pieces of a minute. Each piece has its own dialect, share of
lost bytes, supply voltage, motor lag and speed loop of the firmware, and ends with one wheel that
breaks. An alarm is false if the wheel obeyed the bytes that the board received. A healthy wheel
always does, so every alarm before the end of a piece is false. The table also counts the alarms for
which the board had received another speed than the sent one. A broken wheel shows only while it is
driven, so the time to the cut counts only while the robot is commanded to move. The longest time of
standing meanwhile, after a cut that blamed the line, has a row of its own.

The second line replays one piece, by the number that ``--words`` prints. The third only breaks
wheels. In each piece static friction is up to the largest of STICKS times the moving one, and the
wheels' frictions are between the FRICTION_SCALES, without them those of the default robot. The
fourth drives on a harsher floor than that. A low supply drives against the same friction.
"""

from __future__ import annotations

import argparse
import asyncio
import logging
import math
import random
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from fault_bench import CUT, FaultBench
from floor_options import floor_options

from yahboomd.core.drive.holds import NOT_STARTED
from yahboomd.simulation import virtual_time
from yahboomd.simulation.options import PLAIN_GAIN, QUICK_GAIN, ImpairmentOptions, SimulationOptions

MS = 1_000_000
ALARMS = (
    "stop_not_obeyed",
    "runaway_against",
    "runaway_fast",
    "no_counts",
    "off_speed",
    "turns_without_command",
    "reset_loop",
)
QUIET = ("slow_stops", "noisy_cuts", "not_started")
"""Cuts that latch no fault, by their counter in the status."""

BROKEN = ("phases-swapped", "encoder-reversed", "encoder-dead", "stalled", "unplugged")
LOSSES = (0.0, 0.0, 0.001, 0.01, 0.02, 0.05)
SPEEDS = (0.0, 0.02, 0.03, 0.05, 0.08, 0.1, 0.2, 0.3, 0.5, 0.5, 0.7)
TURNS = (0.0, 0.0, 0.3, 1.0, 3.0, 6.0)
UNLIMITED = ("limits.linear={}", "limits.angular={}")
STOPS = (CUT, b"$spd:0,0,0,0#", b"$speed:0,0,0,0#")
LATELY_NS = 300 * MS


class Bounds(NamedTuple):
    """What robots are drawn from.

    Attributes:
        lags: Of the motors, s.
        volts: Of the supply.
        dialects: One for each part of the robots.
        stick: The most static friction, as a multiple of the moving one.
        scales: Of each wheel's friction, as multiples.
    """

    lags: tuple[float, float]
    volts: tuple[float, float]
    dialects: Sequence[str]
    stick: float
    scales: tuple[float, float]


class Piece(msgspec.Struct, frozen=True, kw_only=True):
    """The properties of one robot.

    Attributes:
        dialect: The firmware.
        loss: Share of bytes lost, each way.
        volts: The supply; the motors are rated for 12 V.
        lag_s: The time constant of a driven motor.
        gain: The gain of the firmware's speed loop.
        missing: The difference of the board's dead zone below the motors', in PWM units.
        unlimited: Whether acceleration is unlimited.
        stick: Static friction as a multiple of the moving one; 1: none.
        friction_scales: Of the two motors.
    """

    dialect: str
    loss: float
    volts: float
    lag_s: float
    gain: float
    missing: int
    unlimited: bool
    stick: float
    friction_scales: tuple[float, float]

    @staticmethod
    def draw(chance: random.Random, floor: random.Random, bounds: Bounds) -> Piece:
        """Choose the properties of one robot with healthy wheels; ``floor`` its friction."""
        gain = chance.choice((PLAIN_GAIN, QUICK_GAIN))
        return Piece(
            dialect=chance.choice(bounds.dialects),
            loss=chance.choice(LOSSES),
            volts=chance.uniform(*bounds.volts),
            lag_s=chance.uniform(*bounds.lags),
            gain=gain,
            missing=chance.randrange(20, 120 if gain == PLAIN_GAIN else 400),
            unlimited=chance.random() < 0.3,
            stick=floor.uniform(1.0, bounds.stick),
            friction_scales=(floor.uniform(*bounds.scales), floor.uniform(*bounds.scales)),
        )


class Tally:
    """The results of all pieces."""

    def __init__(self) -> None:
        self.minutes = 0.0
        self.alarms: Counter[str] = Counter()
        self.garbled: Counter[str] = Counter()
        self.counters: Counter[str] = Counter()
        self.by_loss: Counter[float] = Counter()
        self.cuts_ms: dict[str, list[float]] = {fault: [] for fault in BROKEN}
        self.cuts_by_loss_ms: dict[float, list[float]] = {loss: [] for loss in LOSSES}
        self.stood_ms: list[float] = []
        self.missed: Counter[str] = Counter()
        self.held = 0
        self.words: list[str] = []


class Received:
    """Compares the speeds that the board received with those that were sent."""

    def __init__(self, bench: FaultBench) -> None:
        self._bench = bench
        self._control: Any = bench.robot.board._control  # type: ignore[attr-defined]
        self._regulate = self._control.regulate
        self._control.regulate = self._take
        self.wrong_ns = 0

    def _take(self, targets: tuple[int, ...]) -> None:
        now_ns = self._bench.clock.now_ns()
        sent = {bytes(order) for _, order in self._bench.orders_of_late(now_ns - LATELY_NS)}
        said = ",".join(map(str, targets)).encode()
        if not any(said in order for order in sent):
            self.wrong_ns = now_ns
        self._regulate(targets)


class AlarmBench(FaultBench):
    """A bench that keeps only the latest frames."""

    def orders_of_late(self, since_ns: int) -> list[tuple[int, bytes]]:
        port = self.ports[-1]
        late = []
        for at_ns, data in reversed(port.written):
            if at_ns < since_ns and late:
                break
            late.append((at_ns, data))
        return late


async def piece(
    what: Piece, tally: Tally, *, number: int, seconds: float, chance: random.Random
) -> None:
    """Drive one robot, then break one of its wheels."""
    # Without static friction a low supply lowers the top speed alone.
    rated_volts = 12.0 if what.stick > 1.0 else what.volts
    simulation = SimulationOptions(
        dialect=what.dialect,
        max_speed_m_s=1.15 * rated_volts / 12.0,
        rated_volts=rated_volts,
        battery_volts=what.volts,
        friction_scales=what.friction_scales,
        sticks=(what.stick,),
        time_constant_s=what.lag_s,
        loop_gain=what.gain,
        motor_dead_zone=1600 + what.missing,
        seed=chance.randrange(1 << 30),
    )
    with tempfile.TemporaryDirectory() as folder:
        overrides = UNLIMITED if what.unlimited else ()
        async with AlarmBench(Path(folder), overrides, simulation) as bench:
            await bench.ready()
            received = Received(bench)
            bench.robot.impairments.settings = ImpairmentOptions(loss=what.loss)
            began_ns = bench.clock.now_ns()
            while (bench.clock.now_ns() - began_ns) / 1e9 < seconds:
                await _wish(bench, chance)
                at_s = (bench.clock.now_ns() - began_ns) / 1e9
                _judge(bench, f"piece {number} at {at_s:.1f} s", what, received, tally)
                await _cleared(bench)
                bench.truth.clear()
            tally.minutes += (bench.clock.now_ns() - began_ns) / 60e9
            await _broken(bench, chance, what, tally, number)
            counters = bench.controller.counters
            tally.counters.update({name: counters[name] for name in (*QUIET, "cuts")})


async def _wish(bench: AlarmBench, chance: random.Random) -> None:
    vx = chance.choice(SPEEDS) * chance.choice((1, -1))
    await bench.drive(chance.choice((0.1, 0.3, 0.6, 1.2, 2.0)), vx, _turn(chance))
    match chance.randrange(8):
        case 0 | 1:
            bench.command(0.0)
            await asyncio.sleep(chance.choice((0.05, 0.3, 1.5)))
        case 2:
            bench.controller.bus_lost()
            await asyncio.sleep(0.2)
        case 3:
            await asyncio.sleep(chance.choice((0.6, 2.5)))


def _turn(chance: random.Random) -> float:
    return chance.choice(TURNS) * chance.choice((1, -1))


def _judge(bench: AlarmBench, where: str, what: Piece, received: Received, tally: Tally) -> None:
    for event in bench.heard.events:
        if event.kind not in ALARMS:
            continue
        tally.alarms[event.kind] += 1
        tally.by_loss[what.loss] += 1
        if bench.clock.now_ns() - received.wrong_ns < 4000 * MS:
            tally.garbled[event.kind] += 1
        tally.words.append(f"{event.kind}: {event.message[:70]} {where}, {what}")
    bench.heard.events.clear()
    bench.heard.estimates.clear()
    bench.heard.commands.clear()


async def _cleared(bench: AlarmBench) -> None:
    for _ in range(20):
        if bench.controller.state()[0] not in {"fault", "waiting"}:
            return
        await asyncio.sleep(1.0)
        bench.operator.release_estop()


async def _broken(
    bench: AlarmBench, chance: random.Random, what: Piece, tally: Tally, number: int
) -> None:
    fault = chance.choice(BROKEN)
    await bench.drive(1.5, 0.3)
    cuts = bench.controller.counters["cuts"]
    bench.command(0.3)
    at_ns = bench.clock.now_ns()
    bench.do(f"{fault} {chance.choice(('left', 'right'))}")
    if bench.controller.state()[0] == "fault":
        return
    if bench.controller._holds.has(NOT_STARTED):
        # The floor holds it at this speed: it stands, and no wheel can show a fault.
        tally.held += 1
        return
    wheels = bench.controller._wheels
    driven_ms = 0
    for step in range(4000):
        if step % 50 == 0:
            bench.command(0.3)
        if bench.controller.counters["cuts"] > cuts:
            break
        driven_ms += any(wheels.command_m_s)
        await asyncio.sleep(0.001)
    else:
        tally.missed[fault] += 1
        tally.words.append(f"{fault}: never cut in piece {number}, {what}")
        return
    tally.cuts_ms[fault].append(driven_ms)
    tally.cuts_by_loss_ms[what.loss].append(driven_ms)
    tally.stood_ms.append((bench.clock.now_ns() - at_ns) / MS - driven_ms)


def run(*, numbers: range, seed: int, piece_s: float, bounds: Bounds) -> Tally:
    """Run all pieces, one after the other."""
    tally = Tally()
    for number in numbers:
        chance = random.Random(f"{seed} {number}")
        what = Piece.draw(chance, random.Random(f"{seed} {number} floor"), bounds)
        virtual_time.run(piece(what, tally, number=number, seconds=piece_s, chance=chance))
    return tally


def table(tally: Tally) -> str:
    """The table of results."""
    lines = ["| | |", "|---|---|", f"| minutes driven | {tally.minutes:.0f} |"]
    lines += [f"| false alarms | {sum(tally.alarms.values())} |"]
    lines += [
        f"| `{kind}` | {tally.alarms[kind]}, {tally.garbled[kind]} after a garbled command |"
        for kind in ALARMS
        if tally.alarms[kind]
    ]
    lines += [f"| {name} | {count} |" for name, count in sorted(tally.counters.items())]
    for fault, measured in tally.cuts_ms.items():
        cuts = sorted(measured)
        if cuts:
            lines.append(
                f"| {fault}: to the cut, ms | {cuts[len(cuts) // 2]:.0f} at the median, "
                f"{cuts[-1]:.0f} at worst, of {len(cuts)} |"
            )
        if tally.missed[fault]:
            lines.append(f"| {fault}: never cut | {tally.missed[fault]} |")
    for loss, measured in tally.cuts_by_loss_ms.items():
        if cuts := sorted(measured):
            lines.append(
                f"| {loss:.1%} lost: to the cut, ms | {cuts[len(cuts) // 2]:.0f} at the median, "
                f"{cuts[len(cuts) * 95 // 100]:.0f} at 95 %, {cuts[-1]:.0f} at worst, "
                f"of {len(cuts)} |"
            )
    if tally.held:
        lines.append(f"| not broken, as the floor held the robot at 0.3 m/s | {tally.held} |")
    if tally.stood_ms:
        lines.append(f"| stood between the break and the cut, ms | {max(tally.stood_ms):.0f} |")
    lines.append(f"| by loss | {dict(sorted(tally.by_loss.items()))} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--lags", type=float, nargs=2, default=(0.05, 0.3), metavar="S")
    parser.add_argument("--volts", type=float, nargs=2, default=(8.0, 12.0), metavar="V")
    parser.add_argument(
        "--dialects", nargs="+", default=("streamed", "streamed", "polled"), metavar="DIALECT"
    )
    parser.add_argument("--piece", type=float, default=60.0, metavar="S")
    parser.add_argument("--first", type=int, default=0, help="the number of the first piece")
    parser.add_argument("--pieces", type=int, help="the number of pieces, instead of --minutes")
    parser.add_argument("--words", action="store_true", help="each alarm and miss")
    args = parser.parse_args()
    logging.disable()
    pieces = args.pieces or math.ceil(args.minutes * 60 / args.piece)
    numbers = range(args.first, args.first + pieces)
    floor = SimulationOptions(**floor_options())
    bounds = Bounds(
        lags=tuple(args.lags),
        volts=tuple(args.volts),
        dialects=args.dialects,
        stick=max(floor.sticks),
        scales=(min(floor.friction_scales), max(floor.friction_scales)),
    )
    tally = run(numbers=numbers, seed=args.seed, piece_s=args.piece, bounds=bounds)
    print(table(tally))
    if args.words:
        print("\n".join(tally.words))


if __name__ == "__main__":
    main()
