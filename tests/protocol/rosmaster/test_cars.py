from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.kinematics import KINEMATICS
from yahboomd.core.errors import BoardError
from yahboomd.core.model import Motor
from yahboomd.core.protocol.rosmaster.cars import CARS, body
from yahboomd.simulation.rosmaster.car_types import CAR_TYPES

MECANUM = KINEMATICS["mecanum"](separation_m=0.17, base_m=0.16)
FOUR = KINEMATICS["skid_steer"](separation_m=0.3)
TWO = KINEMATICS["differential"](separation_m=0.15)
speeds = st.floats(-1.0, 1.0)


def motor(wheel: int, position: int, *, sign: int = 1, radius_m: float = 0.0325) -> Motor:
    return Motor(
        name=f"m{position}",
        wheel=wheel,
        position=position,
        command_sign=sign,
        radius_m=radius_m,
        ticks_per_revolution=1320.0,
    )


CORNERS = tuple(motor(wheel, wheel + 1) for wheel in range(4))
SIDES = (motor(0, 1), motor(0, 2), motor(1, 3), motor(1, 4))
PAIR = (motor(0, 1), motor(1, 3))


def turned(car, units):
    """The firmware's result for a velocity: mm/s of each motor that it drives."""
    vx, vy, wz = units
    return {at: a * vx + b * vy + c * wz / 1000.0 for at, (a, b, c) in car.motors.items()}


def rims(kinematics, twist):
    """The rim speeds of a twist."""
    return [sum(f * t for f, t in zip(row, twist, strict=True)) for row in kinematics.inverse]


def test_the_cars_are_those_of_the_firmware():
    assert {number: car.name for number, car in CARS.items()} == {
        1: "X3",
        2: "X3 Plus",
        4: "X1",
        5: "R2",
        6: "Sunrise",
        10: "M1",
    }
    assert (CARS[2].turn_mm, CARS[2].turn_counts, CARS[2].fastest_mm_s) == (251.327, 2464, 700)
    assert CARS[1].motors[1] == (1.0, -1.0, -164.555)
    assert set(CARS[5].motors) == {2, 4}


@pytest.mark.parametrize("number", [1, 2, 6, 10])
@given(twist=st.tuples(speeds, speeds, st.floats(-3.0, 3.0)))
def test_mecanum_wheels_turn_as_wanted_whatever_chassis_the_board_believes_in(number, twist):
    car = CARS[number]
    wanted = rims(MECANUM, twist)
    mm_s = turned(car, body(car, MECANUM, CORNERS, scale=1.0).units(wanted))
    # The board's millimetre is by its own wheel.
    per_m = car.turn_mm / car.turn_counts / CORNERS[0].metres_per_tick
    for wheel, value in enumerate(wanted):
        assert mm_s[wheel + 1] == pytest.approx(per_m * value, abs=1.2)


@pytest.mark.parametrize("number", [1, 4])
@pytest.mark.parametrize(("kinematics", "motors"), [(FOUR, SIDES), (TWO, PAIR)])
@given(left=speeds, right=speeds)
def test_sides_turn_as_wanted(number, kinematics, motors, left, right):
    car = CARS[number]
    units = body(car, kinematics, motors, scale=1.0).units((left, right))
    assert units[1] == 0
    mm_s = turned(car, units)
    per_m = car.turn_mm / car.turn_counts / motors[0].metres_per_tick
    for each in motors:
        wanted = per_m * (left if each.wheel == 0 else right)
        assert mm_s[each.position] == pytest.approx(wanted, abs=1.2)


def test_a_velocity_within_the_limits_is_never_clamped_by_the_board():
    motion = body(CARS[1], MECANUM, CORNERS, scale=1.0)
    for signs in ((1, 1, 1, 1), (-1, 1, 1, -1), (-1, -1, 1, 1)):
        fastest = [sign * limit for sign, limit in zip(signs, motion.wheel_limits, strict=True)]
        clamped = turned(CARS[1], motion.units(fastest))
        assert 990.0 < max(map(abs, clamped.values())) <= 1000.0


def test_the_scale_and_another_wheel_change_the_units():
    assert body(CARS[1], TWO, PAIR, scale=1.0).units((0.3, 0.3)) == (300, 0, 0)
    assert body(CARS[1], TWO, PAIR, scale=1.1).units((0.3, 0.3)) == (330, 0, 0)
    larger = (motor(0, 1, radius_m=0.065), motor(1, 3, radius_m=0.065))
    assert body(CARS[1], TWO, larger, scale=1.0).units((0.3, 0.3)) == (150, 0, 0)


def test_wheels_of_slightly_different_radii_are_no_other_geometry():
    motors = (motor(0, 1, radius_m=0.0325), motor(1, 3, radius_m=0.0327))
    ahead, _, round_ = body(CARS[1], TWO, motors, scale=1.0).units((0.3, 0.3))
    assert ahead == pytest.approx(299, abs=1)
    assert round_ < 0


def test_motors_at_other_places_are_commanded_by_where_they_are():
    # As one owner measured it: M1 rear right, M2 front right, M3 rear left, M4 front left.
    motors = (motor(0, 4), motor(1, 3), motor(2, 2), motor(3, 1))
    motion = body(CARS[1], MECANUM, motors, scale=1.0)
    for twist in ((0.3, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 1.0)):
        wanted = rims(MECANUM, twist)
        mm_s = turned(CARS[1], motion.units(wanted))
        for each in motors:
            assert mm_s[each.position] == pytest.approx(1000.0 * wanted[each.wheel], abs=1.2)


def test_a_base_mounted_the_other_way_round_is_commanded_backward():
    motors = tuple(msgspec.structs.replace(each, command_sign=-1) for each in CORNERS)
    motion = body(CARS[1], MECANUM, motors, scale=1.0)
    assert motion.units((0.3,) * 4) == (-300, 0, 0)


@pytest.mark.parametrize(
    ("number", "kinematics", "motors", "words"),
    [
        (1, MECANUM, (*CORNERS[:3], motor(3, 4, sign=-1)), "divides a motion"),
        (1, MECANUM, (motor(0, 2), motor(1, 4), motor(2, 3), motor(3, 1)), "driving round"),
        (4, MECANUM, CORNERS, "driving sideways"),
        (1, TWO, (motor(0, 1), motor(1, 2)), "driving ahead"),
        (5, TWO, PAIR, "no motor at M1"),
    ],
)
def test_what_the_board_would_turn_otherwise_is_refused(number, kinematics, motors, words):
    with pytest.raises(BoardError, match=words):
        body(CARS[number], kinematics, motors, scale=1.0)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_no_speed_that_is_no_number_is_sent(bad):
    with pytest.raises(ValueError, match="command is"):
        body(CARS[1], TWO, PAIR, scale=1.0).units((0.1, bad))


@pytest.mark.parametrize("number", CAR_TYPES)
def test_a_car_is_the_one_that_the_simulated_firmware_has(number: int) -> None:
    car, simulated = CARS[number], CAR_TYPES[number]
    assert car.turn_mm == simulated.circle_mm
    assert car.turn_counts == simulated.circle_counts
    assert car.fastest_mm_s == simulated.clamp_mm_s
    assert (car.wheelbase_mm or 0.0) == simulated.axles_mm


def test_the_law_of_each_geometry_is_the_firmwares_motor_by_motor():
    assert CARS[1].motors == {
        1: (1.0, -1.0, -164.555),
        2: (1.0, 1.0, -164.555),
        3: (1.0, 1.0, 164.555),
        4: (1.0, -1.0, 164.555),
    }
    assert CARS[4].motors == {
        1: (1.0, 0.0, -164.555),
        2: (1.0, 0.0, -164.555),
        3: (1.0, 0.0, 164.555),
        4: (1.0, 0.0, 164.555),
    }
    assert CARS[5].motors == {2: (1.0, 0.0, -95.55), 4: (1.0, 0.0, 95.55)}


def test_each_car_has_the_wheels_and_the_speed_of_the_firmware():
    assert [(car.turn_mm, car.turn_counts, car.fastest_mm_s) for car in CARS.values()] == [
        (204.203, 1320, 1000),
        (251.327, 2464, 700),
        (215.2, 1320, 1000),
        (215.2, 836, 2000),
        (204.203, 1040, 1000),
        (251.327, 2464, 700),
    ]
    assert [CARS[number].motors[3][2] for number in (1, 2, 4, 6, 10)] == [
        164.555,
        214.1,
        164.555,
        143.68,
        189.5,
    ]
    assert [car.wheelbase_mm for car in CARS.values()] == [None, None, None, 235.37, None, None]
