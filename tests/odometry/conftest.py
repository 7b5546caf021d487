"""A base, its motors, and a board that counts exactly and talks over a line that delays."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from typing import NamedTuple

import pytest

from yahboomd.core.model import EncoderReading, Kinematics, Motor

TRACK_M = 0.17
RADIUS_M = 0.0335
TICKS = 1320.0
TICK_M = 2.0 * math.pi * RADIUS_M / TICKS
START_NS = 1_000_000_000_000


def _differential(track_m: float = TRACK_M) -> Kinematics:
    return Kinematics(
        name="differential",
        wheels=("left", "right"),
        inverse=((1.0, 0.0, -track_m / 2), (1.0, 0.0, track_m / 2)),
        forward=((0.5, 0.5), (0.0, 0.0), (-1.0 / track_m, 1.0 / track_m)),
    )


def _mecanum(k: float = 0.2) -> Kinematics:
    return Kinematics(
        name="mecanum",
        wheels=("front_left", "rear_left", "rear_right", "front_right"),
        inverse=((1.0, -1.0, -k), (1.0, 1.0, -k), (1.0, -1.0, k), (1.0, 1.0, k)),
        forward=(
            (0.25, 0.25, 0.25, 0.25),
            (-0.25, 0.25, -0.25, 0.25),
            (-0.25 / k, -0.25 / k, 0.25 / k, 0.25 / k),
        ),
        holonomic=True,
    )


def _motors(
    wheels: tuple[int, ...] = (0, 1),
    *,
    positions: tuple[int, ...] | None = None,
    ticks: float = TICKS,
    signs: tuple[int, ...] | None = None,
) -> tuple[Motor, ...]:
    return tuple(
        Motor(
            name=f"motor_{index}",
            wheel=wheel,
            position=positions[index] if positions else index + 1,
            encoder_sign=signs[index] if signs else 1,
            radius_m=RADIUS_M,
            ticks_per_revolution=ticks,
        )
        for index, wheel in enumerate(wheels)
    )


class Line(NamedTuple):
    """A line of totals as it arrived, and when the board sampled its counts."""

    reading: EncoderReading
    sampled_ns: int


def _stream(
    rate: Callable[[float], tuple[float, float]],
    *,
    seconds: float,
    gap_ms: float = 2.4613,
    wire_ms: float = 1.39,
    timer_ms: float = 0.0,
    ppm: float = 0.0,
    loss: float = 0.0,
    seed: int = 0,
    tick_ms: float = 10.0,
) -> Iterator[Line]:
    """The lines of a board that renews its totals periodically by its own clock.

    Args:
        rate: Ticks a second of the left and the right wheel, over seconds.
        seconds: The duration.
        gap_ms: From line to line.
        wire_ms: The time of a line on the wire.
        timer_ms: The period at which the USB bridge delivers its bytes; 0 delivers at once.
        ppm: The error of the board's ticks, positive for too long.
        loss: The share of lines that get lost.
        seed: For the phases of the three clocks.
        tick_ms: The period at which the board renews its totals; 0: with every line.
    """
    chance = random.Random(seed)
    every_line = not tick_ms
    tick_ms = (tick_ms or gap_ms) * (1.0 + ppm * 1e-6)
    next_ms = chance.uniform(0.0, tick_ms)
    sampled_ms = next_ms - tick_ms
    flush_ms = chance.uniform(0.0, timer_ms)
    totals = [chance.random(), chance.random()]
    counts = (0, 0, 0, 0)
    sent_ms = next_ms if every_line else chance.uniform(0.0, 10.0)
    held: list[tuple[tuple[int, int, int, int], float, float]] = []

    def line(counts: tuple[int, int, int, int], sampled: float, received: float) -> Line:
        received_ns = START_NS + round(received * 1e6)
        sent_ns = received_ns - round(wire_ms * 1e6)
        reading = EncoderReading(ticks=counts, received_ns=received_ns, sent_ns=sent_ns)
        return Line(reading, START_NS + round(sampled * 1e6))

    while sent_ms < seconds * 1e3:
        while next_ms <= sent_ms + 1e-6:
            for index, speed in enumerate(rate((next_ms - tick_ms / 2) * 1e-3)):
                totals[index] += speed * tick_ms * 1e-3
            counts = (math.floor(totals[0]), math.floor(totals[1]), 0, 0)
            sampled_ms, next_ms = next_ms, next_ms + tick_ms
        end_ms = sent_ms + wire_ms
        while timer_ms and end_ms > flush_ms:
            for behind, (content, sampled, _) in enumerate(reversed(held)):
                held[len(held) - 1 - behind] = (content, sampled, flush_ms - behind * wire_ms)
            for item in held:
                if chance.random() >= loss:
                    yield line(*item)
            held.clear()
            flush_ms += timer_ms
        if timer_ms:
            held.append((counts, sampled_ms, 0.0))
        elif chance.random() >= loss:
            yield line(counts, sampled_ms, end_ms)
        sent_ms += gap_ms


class Kit(NamedTuple):
    """Builders for the tests of this room."""

    differential: Callable[..., Kinematics]
    mecanum: Callable[..., Kinematics]
    motors: Callable[..., tuple[Motor, ...]]
    stream: Callable[..., Iterator[Line]]
    track_m: float
    tick_m: float


@pytest.fixture(scope="session")
def kit() -> Kit:
    return Kit(_differential, _mecanum, _motors, _stream, TRACK_M, TICK_M)
