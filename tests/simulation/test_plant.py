from __future__ import annotations

import math
from random import Random

import pytest

from yahboomd.simulation.motors import PWM_MAX
from yahboomd.simulation.options import SMOOTH, SimulationOptions, Wiring
from yahboomd.simulation.plant import Plant


def plant(**options: object) -> Plant:
    made = Plant(SimulationOptions(**options), Random(1))
    made.start(0)
    return made


def test_outputs_reach_the_motors_by_their_position() -> None:
    base = plant()
    base.set_outputs((0, PWM_MAX, PWM_MAX, PWM_MAX))
    base.advance(500_000_000)
    left, right = base.motors
    assert left.travel_m == 0.0
    assert right.travel_m > 0.3
    a, b, c, d = base.ticks
    assert (a, b, d) == (0, 0, 0)
    assert c > 1000


def test_counts_per_metre_follow_from_lines_ratio_and_wheel() -> None:
    base = plant()
    base.set_outputs((3000, 0, 3000, 0))
    base.advance(2_000_000_000)
    revolutions = base.motors[0].travel_m / (2 * 3.141592653589793 * 0.0335)
    assert base.ticks[0] == pytest.approx(revolutions * 1320, abs=1.0)


def test_the_result_does_not_depend_on_how_often_it_is_asked() -> None:
    seldom, often = plant(), plant()
    for base in (seldom, often):
        base.set_outputs((3000, 0, 2500, 0))
    seldom.advance(1_000_000_000)
    for now_ns in range(0, 1_000_000_001, 1_700_000):
        often.advance(now_ns)
    often.advance(1_000_000_000)
    assert often.chassis.pose.x == pytest.approx(seldom.chassis.pose.x, abs=1e-7)
    assert often.chassis.pose.theta == pytest.approx(seldom.chassis.pose.theta, abs=1e-6)


def test_a_larger_wheel_bends_the_way_of_equal_turns() -> None:
    wiring = (
        Wiring(name="left", position=1, corner="left"),
        Wiring(name="right", position=3, corner="right", radius_scale=1.01),
    )
    base = plant(wiring=wiring, **SMOOTH)
    base.set_outputs((3000, 0, 3000, 0))
    base.advance(3_000_000_000)
    assert base.ticks[0] == pytest.approx(base.ticks[2], abs=1)
    left, right = (motor.travel_m for motor in base.motors)
    assert right / left == pytest.approx(1.01)
    assert base.chassis.pose.theta == pytest.approx((right - left) / 0.15)


def test_the_battery_sags_under_load() -> None:
    base = plant()
    assert base.volts == 7.4
    base.set_outputs((PWM_MAX, 0, PWM_MAX, 0))
    assert base.volts < 7.2


def test_each_motor_has_its_own_friction() -> None:
    base = plant(
        drive="skid_steer", motor_dead_zone=2000, friction_scales=(1.0, 0.9), sticks=(1.25,)
    )
    base.set_outputs((2300,) * 4)
    base.advance(500_000_000)
    assert [motor.travel_m > 0.0 for motor in base.motors] == [False, True, False, True]
    base.set_outputs((2501,) * 4)
    base.advance(1_000_000_000)
    assert all(motor.travel_m > 0.0 for motor in base.motors)
    assert base.motors[1].speed_m_s > base.motors[0].speed_m_s


def test_a_weaker_supply_drives_against_the_same_friction() -> None:
    base = plant(rated_volts=12.0, battery_volts=12.0)
    base.set_outputs((PWM_MAX, 0, PWM_MAX, 0))
    base.advance(1_000_000_000)
    base.battery_volts = 8.0
    base.advance(2_000_000_000)
    assert base.motors[0].speed_m_s == pytest.approx(
        1.15 * (PWM_MAX * 8.0 / 12.0 - 1950) / (PWM_MAX - 1950), abs=0.001
    )


def test_crossed_encoder_plugs_exchange_the_counts_and_make_no_jump() -> None:
    base = plant()
    base.set_outputs((3000, 0, 0, 0))
    base.advance(500_000_000)
    before = base.ticks
    base.cross_encoders(1, 4)
    assert base.ticks == before
    base.advance(1_000_000_000)
    a, _, _, d = base.ticks
    assert a == before[0]
    assert d - before[3] > 1000
    base.cross_encoders(4, 1)
    base.advance(1_500_000_000)
    assert base.ticks[0] - a > 1000
    assert base.ticks[3] == d


@pytest.mark.parametrize("output", [0, 3000])
def test_a_servo_takes_its_time_to_steer_and_a_base_without_one_turns_by_its_rims(
    output: int,
) -> None:
    car = plant(drive="ackermann", wheel_base_m=0.25)
    car.steer(0.0)
    car.set_outputs((0, output, 0, output))
    car.steer(35.0)
    car.advance(50_000_000)
    assert car.chassis.turn_per_m == pytest.approx(math.tan(math.radians(17.5)) / 0.25)
    car.advance(300_000_000)
    assert car.chassis.turn_per_m == pytest.approx(math.tan(math.radians(35.0)) / 0.25)
    other = plant()
    other.steer(35.0)
    assert other.chassis.turn_per_m is None
