from __future__ import annotations

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.simulation.motors import (
    FAULTS,
    PWM_MAX,
    MotorFaults,
    MotorLaw,
    MotorState,
    joined,
)

LAW = MotorLaw(max_speed_m_s=1.15, dead_zone=1950, time_constant_s=0.06, ticks_per_metre=6000.0)


def turn(motor: MotorState, seconds: float) -> float:
    return sum(motor.advance(0.001, round(seconds * 1000)))


def driven(
    pwm: int = PWM_MAX, seconds: float = 1.0, faults: MotorFaults | None = None
) -> MotorState:
    motor = MotorState(LAW)
    motor.pwm = pwm
    if faults is not None:
        motor.faults = faults
    turn(motor, seconds)
    return motor


def test_full_output_reaches_full_speed_and_the_sign_follows() -> None:
    assert driven(PWM_MAX).speed_m_s == pytest.approx(1.15, rel=1e-6)
    assert driven(-PWM_MAX).speed_m_s == pytest.approx(-1.15, rel=1e-6)


def test_output_inside_the_dead_zone_moves_nothing() -> None:
    assert driven(LAW.dead_zone).travel_m == 0.0
    assert driven(LAW.dead_zone + 100).speed_m_s > 0.0


def test_the_lag_is_of_first_order() -> None:
    motor = driven(PWM_MAX, LAW.time_constant_s)
    assert motor.speed_m_s == pytest.approx(1.15 * (1.0 - math.exp(-1.0)), rel=1e-9)


def test_the_travel_does_not_depend_on_the_steps() -> None:
    fine, coarse = MotorState(LAW), MotorState(LAW)
    fine.pwm = coarse.pwm = 3000
    turn(fine, 0.2)
    coarse.advance(0.2)
    assert fine.travel_m == pytest.approx(coarse.travel_m, rel=1e-12)


@pytest.mark.parametrize(("pull_m_s2", "speed_m_s"), [(0.29, 0.0), (0.98, 0.102), (-1.92, -0.243)])
def test_a_motor_without_output_rolls_down_a_slope_that_overcomes_its_friction(
    pull_m_s2: float, speed_m_s: float
) -> None:
    motor = MotorState(LAW)
    motor.pull_m_s2 = pull_m_s2
    turn(motor, 2.0)
    # What pulls less its friction, over the coast's time constant.
    assert motor.speed_m_s == pytest.approx(speed_m_s, abs=0.001)
    motor.pwm = 1
    turn(motor, 1.0)
    assert motor.speed_m_s == pytest.approx(0.0, abs=1e-4)


def test_a_slope_speeds_a_driven_motor_up() -> None:
    motor = driven(3000)
    before = motor.speed_m_s
    motor.pull_m_s2 = 1.0
    turn(motor, 1.0)
    assert motor.speed_m_s == pytest.approx(before + 0.06, abs=1e-3)


def test_a_motor_without_output_coasts_and_comes_to_rest() -> None:
    motor = driven()
    motor.pwm = 0
    turn(motor, 0.05)
    assert 0.5 < motor.speed_m_s < 1.15
    turn(motor, 2.0)
    assert motor.speed_m_s == 0.0
    assert motor.at_rest


def test_counts_follow_the_travel() -> None:
    motor = driven(3000)
    assert motor.ticks == math.floor(motor.travel_m * 6000.0)


def test_signs_say_how_it_is_mounted() -> None:
    mirrored = MotorState(msgspec.structs.replace(LAW, command_sign=-1, encoder_sign=-1))
    mirrored.pwm = PWM_MAX
    turn(mirrored, 0.5)
    assert mirrored.speed_m_s < 0
    assert mirrored.ticks > 0


def test_a_dead_encoder_counts_nothing_while_the_wheel_turns() -> None:
    motor = driven(faults=FAULTS["encoder-dead"])
    assert motor.travel_m > 0.5
    assert motor.ticks == 0


def test_a_reversed_encoder_counts_backward() -> None:
    motor = driven(faults=FAULTS["encoder-reversed"])
    assert motor.travel_m > 0.5
    assert motor.ticks < -3000


def test_swapped_phases_turn_the_wheel_the_other_way() -> None:
    motor = driven(faults=FAULTS["phases-swapped"])
    assert motor.travel_m < -0.5
    assert motor.ticks < -3000


def test_a_stalled_wheel_stands_at_full_output() -> None:
    motor = driven(faults=FAULTS["stalled"])
    assert motor.travel_m == 0.0
    assert motor.at_rest


def test_an_unplugged_motor_neither_turns_nor_counts() -> None:
    motor = driven(faults=FAULTS["unplugged"])
    assert motor.travel_m == 0.0
    rolling = driven()
    before = rolling.ticks
    rolling.faults = FAULTS["unplugged"]
    turn(rolling, 0.1)
    assert rolling.speed_m_s > 0.0
    assert rolling.ticks == before


def test_a_dead_motor_counts_when_it_is_turned_by_hand() -> None:
    assert driven(faults=FAULTS["motor-dead"]).travel_m == 0.0
    pushed = driven(faults=joined(FAULTS["motor-dead"], FAULTS["turning"]))
    assert pushed.travel_m > 0.0
    assert pushed.ticks > 0


def test_a_motor_that_is_mounted_the_other_way_round_turns_and_counts_the_other_way() -> None:
    motor = driven(faults=FAULTS["mounted-round"])
    assert motor.travel_m < 0.0
    assert motor.ticks > 0


def test_faults_add_up() -> None:
    both = joined(FAULTS["mounted-round"], FAULTS["encoder-reversed"])
    motor = driven(faults=both)
    assert motor.travel_m < 0.0
    assert motor.ticks < 0
    slow = joined(FAULTS["turning"], MotorFaults(turning_m_s=0.1))
    assert slow == MotorFaults(turning_m_s=0.1)


def test_a_wheel_can_turn_without_command() -> None:
    motor = driven(0, faults=MotorFaults(turning_m_s=0.3))
    assert motor.speed_m_s == pytest.approx(0.3, rel=1e-6)
    assert motor.ticks > 1000
    assert not motor.at_rest


@given(
    st.lists(st.integers(-PWM_MAX, PWM_MAX), min_size=1, max_size=10),
    st.sampled_from(sorted(FAULTS)),
)
def test_no_wheel_is_faster_than_full_output_makes_it(outputs: list[int], fault: str) -> None:
    motor = MotorState(LAW)
    motor.faults = FAULTS[fault]
    for pwm in outputs:
        motor.pwm = pwm
        assert abs(*motor.advance(0.05)) <= 1.15 * 0.05 + 1e-9
        assert abs(motor.speed_m_s) <= 1.15 + 1e-9


STICKY = msgspec.structs.replace(LAW, dead_zone=1500, stick=1.4)
BREAK_AWAY = 2100


def sticky(pwm: int, supply: float = 1.0) -> MotorState:
    motor = MotorState(STICKY)
    motor.pwm, motor.supply = pwm, supply
    turn(motor, 1.0)
    return motor


def test_a_wheel_at_rest_stays_until_the_drive_exceeds_its_static_friction() -> None:
    assert sticky(BREAK_AWAY).travel_m == 0.0
    assert sticky(-BREAK_AWAY).at_rest
    # It leaps: moving friction alone is left.
    leaps_m_s = 1.15 * (BREAK_AWAY - 1500) / (PWM_MAX - 1500)
    assert sticky(BREAK_AWAY + 1).speed_m_s == pytest.approx(leaps_m_s, rel=0.01)
    assert sticky(-BREAK_AWAY - 1).speed_m_s == pytest.approx(-leaps_m_s, rel=0.01)


def test_a_wheel_that_turns_has_the_moving_friction_until_it_stood() -> None:
    motor = sticky(BREAK_AWAY + 1)
    motor.pwm = 1600
    turn(motor, 1.0)
    assert motor.speed_m_s == pytest.approx(1.15 * 100 / 2100, rel=0.01)
    motor.pwm = 1500
    turn(motor, 1.0)
    assert motor.speed_m_s == 0.0
    motor.pwm = 1600
    turn(motor, 1.0)
    assert motor.speed_m_s == 0.0


def test_a_wheel_that_is_driven_back_sticks_as_it_comes_through_rest() -> None:
    motor = sticky(PWM_MAX)
    motor.pwm = -BREAK_AWAY
    turn(motor, 1.0)
    assert motor.speed_m_s == 0.0
    motor.pwm = -BREAK_AWAY - 1
    turn(motor, 1.0)
    assert motor.speed_m_s < 0.0


def test_a_low_battery_raises_the_break_away_output() -> None:
    assert sticky(2400, supply=0.87).travel_m == 0.0
    assert sticky(2400, supply=0.88).travel_m > 0.0


def test_a_hand_turns_a_wheel_that_sticks() -> None:
    motor = sticky(0)
    motor.faults = MotorFaults(turning_m_s=0.001)
    turn(motor, 1.0)
    assert motor.travel_m > 0.0
