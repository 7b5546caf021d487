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
    assert CAR_TYPES[car].wheels(*velocity) == wheels


def test_a_car_that_steers_has_slower_inner_wheels() -> None:
    speeds, angle = CAR_TYPES[5].steered(500, 0, 20)
    assert angle == 20
    assert speeds[0] == speeds[2] == 0
    assert speeds[1] < 500 < speeds[3]


def test_a_car_that_steers_finds_the_angle_of_a_turn_and_cuts_its_decimals() -> None:
    # atan(1.0 rad/s * 235.37 mm / 500 mm/s) is 25.2 degrees.
    assert CAR_TYPES[5].steered(500, 1000, 0)[1] == 25
    assert CAR_TYPES[5].steered(100, 4000, 0)[1] == 45


@pytest.mark.parametrize(
    ("car", "state", "velocity"),
    [
        (1, 1, (500, 0, 0)),
        (1, 2, (-500, 0, 0)),
        (1, 3, (0, 500, 0)),
        (1, 4, (0, -500, 0)),
        (1, 5, (0, 0, 2500)),
        (1, 6, (0, 0, -2500)),
        (4, 3, (250, 0, 1000)),
        (4, 4, (250, 0, -1000)),
        (5, 2, (-500, 0xFF, 0)),
        (5, 4, (500, -25, 0)),
        (5, 5, (500, 45, 0)),
    ],
)
def test_the_states_of_function_11_are_velocities(
    car: int, state: int, velocity: tuple[int, int, int]
) -> None:
    assert CAR_TYPES[car].run(state, 500) == velocity


@pytest.mark.parametrize("velocity", [(300, 0, 0), (100, 200, 0), (0, 0, 500), (100, 50, -300)])
def test_the_board_believes_the_velocity_that_its_wheels_have(
    velocity: tuple[int, int, int],
) -> None:
    car = CAR_TYPES[1]
    counts = [round(speed / car.mm_s_per_tick) for speed in car.wheels(*velocity)]
    assert car.body(counts, 0) == pytest.approx(velocity, abs=50)


def test_one_count_in_10_ms_is_15_mm_s_on_an_x3() -> None:
    assert CAR_TYPES[1].mm_s_per_tick == pytest.approx(15.47, abs=0.01)
    assert CAR_TYPES[1].body((1, 1, 1, 1), 0) == (15, 0, 0)
    assert CAR_TYPES[5].body((0, 10, 0, 10), 12) == (257, 12, 0)
