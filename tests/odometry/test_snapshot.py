"""A restored odometer goes on bit by bit as the one that was saved."""

from __future__ import annotations

import math
import random

import pytest

from yahboomd.core.model import EncoderReading, ImuReading, ImuSensor, Pose2d
from yahboomd.core.odometry.odometer import Odometer
from yahboomd.core.odometry.snapshot import NotAState, restore, save

MS = 1_000_000
START_NS = 1_000_000_000_000
SENSOR = ImuSensor(
    name="mpu9250",
    gyro_limit_rad_s=8.7,
    gyro_noise_rad_s=0.002,
    acceleration_limit_m_s2=19.6,
    acceleration_noise_m_s2=0.02,
    delay_ns=5 * MS,
)

BOARDS = {
    "asked": (None, False, 0),
    "ticks": (10 * MS, False, 0),
    "each line": (40 * MS, True, 10 * MS),
}


def wheel(ticks: float, chance: random.Random) -> int:
    """Sometimes a digit is garbled, and sometimes the board was reset."""
    return round(ticks) if chance.random() < 0.98 else chance.randrange(2000)


def inputs(kit, board: str, seed: int):
    """Everything that an odometer is given, with faults."""
    chance = random.Random(seed)
    tick_ms = {"asked": 10.0, "ticks": 10.0, "each line": 0.0}[board]
    gap_ms = {"asked": 20.0, "ticks": 2.4613, "each line": 40.0}[board]
    seconds = {"asked": 12.0, "ticks": 4.0, "each line": 25.0}[board]

    def rate(s):
        if s % 5.0 < 1.0:
            return 0.0, 0.0
        return 900.0 + 300.0 * math.sin(s), 850.0

    for number, (reading, _) in enumerate(
        kit.stream(rate, seconds=seconds, gap_ms=gap_ms, tick_ms=tick_ms, loss=0.02, seed=seed)
    ):
        left, right, *_ = reading.ticks
        yield (
            "update",
            EncoderReading(
                ticks=(wheel(left, chance), right, 0, 0),
                received_ns=reading.received_ns,
                sent_ns=reading.sent_ns,
                requested_ns=reading.sent_ns - MS if board == "asked" else None,
                earliest_ns=reading.sent_ns - MS if board == "asked" else None,
                after_gap=number == 0 or chance.random() < 0.003,
                after_reset=chance.random() < 0.002,
            ),
        )
        if chance.random() < 0.3:
            yield (
                "accept",
                ImuReading(
                    sensor=SENSOR,
                    sent_ns=reading.sent_ns + MS,
                    gyro_rad_s=(0.0, 0.0, chance.gauss(0.4, 0.01)),
                    acceleration_m_s2=(0.0, chance.gauss(0.0, 0.01), 9.81),
                ),
            )
        if chance.random() < 0.05:
            yield "armed", None
        if chance.random() < 0.005:
            yield "set_pose", Pose2d(x=chance.random(), theta=chance.random())


def apply(odometer: Odometer, kind: str, value):
    call = getattr(odometer, kind)
    return call() if value is None else call(value)


@pytest.mark.cases(4)
@pytest.mark.cases(6)
@pytest.mark.parametrize("fused", [False, True])
@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_restored_odometer_goes_on_bit_by_bit(kit, board, fused, seed):
    def fresh() -> Odometer:
        return Odometer(kit.differential(), kit.motors(), fused=fused)

    saved = fresh()
    period_ns, each_line, age_ns = BOARDS[board]
    saved.set_sample_period(period_ns, each_line=each_line, age_ns=age_ns)
    chance = random.Random(seed)
    copies: list[Odometer] = []
    estimates = 0
    for kind, value in inputs(kit, board, seed):
        if chance.random() < 0.01 or not copies:
            state = save(saved)
            copy = fresh()
            restore(copy, state)
            assert save(copy) == state
            # Three at a time: an error may show late.
            copies = [*copies[-2:], copy]
        result = apply(saved, kind, value)
        estimates += kind == "update" and result.estimate is not None
        for copy in copies:
            assert apply(copy, kind, value) == result
            assert copy.counters == saved.counters
    assert estimates > 100
    assert all(save(copy) == save(saved) for copy in copies)


def test_a_state_of_another_version_is_refused_and_runs_nothing(kit):
    odometer = Odometer(kit.differential(), kit.motors())
    for state in (b"", b"\x80", b"\xc1", save(odometer).replace(b"Encoders", b"Encodes9")):
        with pytest.raises(NotAState):
            restore(Odometer(kit.differential(), kit.motors()), state)
