from __future__ import annotations

import pytest

from yahboomd.simulation.rosmaster.car_types import CAR_TYPES


@pytest.mark.parametrize(
    ("car", "velocity", "wheels"),
    [
        (1, (200, 0, 0), (200, 200, 200, 200)),
        (1, (0, 200, 0), (-200, 200, 200, -200)),
        (1, (0, 0, 1000), (-164, -164, 164, 164)),
        (1, (900, 500, 0), (400, 1000, 1000, 400)),
        (2, (900, 0, 0), (700, 700, 700, 700)),
        (4, (0, 200, 0), (0, 0, 0, 0)),
        (6, (0, 0, 1000), (-143, -143, 143, 143)),
    ],
)
def test_a_velocity_is_divided_as_the_firmware_does_and_each_wheel_clamped_alone(
    car: int, velocity: tuple[int, int, int], wheels: tuple[int, ...]
) -> None:
    assert CAR_TYPES[car].wheels(*velocity) == (wheels, 0)


def test_a_car_that_steers_takes_vy_for_the_angle_in_degrees() -> None:
    speeds, angle = CAR_TYPES[5].wheels(500, 20, 0)
    assert angle == 20
    assert speeds[0] == speeds[2] == 0
    assert speeds[1] < 500 < speeds[3]
    assert CAR_TYPES[5].wheels(500, 60, 0)[1] == 45
    assert CAR_TYPES[5].wheels(0, -10, 0) == ((0, 0, 0, 0), -10)


def test_a_car_that_steers_finds_the_angle_of_a_turn_and_cuts_its_decimals() -> None:
    # atan(1.0 rad/s * 235.37 mm / 500 mm/s) is 25.2 degrees.
    assert CAR_TYPES[5].wheels(500, 0, 1000)[1] == 25


@pytest.mark.parametrize("velocity", [(300, 0, 0), (100, 200, 0), (0, 0, 500), (100, 50, -300)])
def test_the_board_believes_the_velocity_that_its_wheels_have(
    velocity: tuple[int, int, int],
) -> None:
    car = CAR_TYPES[1]
    speeds, _ = car.wheels(*velocity)
    assert car.body(speeds, 0) == pytest.approx(velocity, abs=6)


def test_one_count_in_10_ms_is_15_mm_s_on_an_x3() -> None:
    assert CAR_TYPES[1].mm_s_per_tick == pytest.approx(15.47, abs=0.01)
    assert CAR_TYPES[5].body((0.0, 300.0, 0.0, 300.0), 12) == (300, 12, 0)
