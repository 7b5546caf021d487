"""The last millimetre."""

from __future__ import annotations

import math

import pytest

from yahboomd.moves.motion.landing import (
    LONGEST_NUDGE_S,
    LONGEST_S,
    Landing,
    RollOn,
    Tolerance,
)

TOLERANCE = Tolerance(
    end=0.001,
    aim=0.0003,
    short=0.004,
    near=0.002,
    least=0.001,
    still=0.0002,
    creep=0.01,
    pulse=0.03,
)
DT_S = 0.02


def rolls() -> RollOn:
    return RollOn(landing=0.001, same=0.0, other=0.002, most=0.005)


def land(left: float, *, lost: tuple[float, float], learned: RollOn) -> tuple[float, float]:
    """Land a base that loses so much of each pulse in the same and in another direction.

    Returns: what is left at the end, and the time.
    """
    landing = Landing(TOLERANCE, learned)
    way, pulse, time_s = 1.0, 0.0, 0.0
    while (speed := landing.step(left, 0.0, DT_S)) is not None:
        time_s += DT_S
        assert time_s < 2.0 * LONGEST_S
        if speed:
            pulse += abs(speed) * DT_S
            sign = 1.0 if speed > 0.0 else -1.0
        elif pulse:
            left -= sign * max(0.0, pulse - lost[sign != way])
            way, pulse = sign, 0.0
    return left, time_s


def test_a_base_within_the_tolerance_is_left_alone() -> None:
    left, time_s = land(0.0008, lost=(0.0, 0.0), learned=rolls())
    assert left == 0.0008
    assert time_s < 0.2


@pytest.mark.parametrize("left", [-0.004, -0.0015, 0.0015, 0.004])
@pytest.mark.parametrize("lost", [(0.0, 0.0), (0.0003, 0.003), (0.001, 0.0045)])
def test_what_is_left_is_corrected(left: float, lost: tuple[float, float]) -> None:
    ended, _ = land(left, lost=lost, learned=rolls())
    assert abs(ended) <= TOLERANCE.end


def test_it_learns_what_a_pulse_loses() -> None:
    learned = rolls()
    for _ in range(6):
        land(-0.003, lost=(0.0, 0.0035), learned=learned)
    assert learned.other == pytest.approx(0.0035, abs=0.0011)


def test_it_learns_to_begin_the_landing_earlier_after_it_rolled_too_far() -> None:
    learned = rolls()
    land(-0.003, lost=(0.0, 0.002), learned=learned)
    assert learned.landing > 0.001


def test_it_waits_until_the_base_stands() -> None:
    landing = Landing(TOLERANCE, rolls())
    for _ in range(40):
        assert landing.step(0.0, 0.005, DT_S) == 0.0
    for step in range(40):
        assert landing.step(0.02 - 0.0005 * step, 0.0, DT_S) == 0.0


def test_a_base_that_does_not_obey_is_given_up() -> None:
    landing = Landing(TOLERANCE, rolls(), most=0.2)
    steps = 0
    while landing.step(0.01, 0.0, DT_S) is not None:
        steps += 1
        assert steps * DT_S < LONGEST_NUDGE_S + 2.0


@pytest.mark.parametrize("needs", [0.02, 0.06])
def test_a_correction_lasts_until_wheels_that_stick_begin(needs: float) -> None:
    """As of a board that forgets a pulse with its end, and of wheels that jump when they start."""
    landing = Landing(TOLERANCE, rolls(), most=0.2)
    left, given, speed, time_s = -0.009, 0.0, 0.0, 0.0
    while (wanted := landing.step(left, 0.0, DT_S)) is not None:
        time_s += DT_S
        given = given + wanted * DT_S if wanted else 0.0
        speed = 0.6 * speed if abs(given) < needs else math.copysign(0.03, given)
        left -= speed * DT_S
    assert abs(left) < TOLERANCE.short
    assert time_s < 8.0


def nudged(landing: Landing, left: float, glides: float) -> float:
    """What is left after a nudge of a base that glides so far once it is over."""
    while not (speed := landing.step(left, 0.0, DT_S)):
        assert speed is not None, "no nudge"
    while speed:
        left -= math.copysign(0.001, speed)
        way = speed
        speed = landing.step(left, 0.0, DT_S) or 0.0
    left -= math.copysign(glides, way)
    for _ in range(7):
        landing.step(left, 0.0, DT_S)
    return left


def test_before_a_jump_is_known_half_of_what_counts_as_reached_is_left_alone() -> None:
    for left, begins in ((0.0018, False), (0.0022, True)):
        learned = rolls()
        learned.sticks = True
        landing = Landing(TOLERANCE, learned)
        steps = [landing.step(left, 0.0, DT_S) for _ in range(20)]
        assert (None in steps) != begins
        assert any(steps) == begins


def test_a_nudge_that_moved_less_than_the_jump_narrows_it() -> None:
    learned = rolls()
    learned.sticks = True
    landing = Landing(TOLERANCE, learned)
    left = nudged(landing, 0.01, 0.03)
    assert left < 0.0
    assert learned.jump == pytest.approx(0.01 - left)
    after = nudged(landing, left, 0.0)
    assert after - left < 0.03
    assert learned.jump == pytest.approx(after - left)
