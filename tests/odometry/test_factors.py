from __future__ import annotations

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.core.odometry.factors import motor_factors


def test_one_tick_of_one_wheel_is_half_a_tick_forward_and_a_turn(kit):
    left, right = motor_factors(kit.differential(), kit.motors())
    assert left.x == pytest.approx(kit.tick_m / 2)
    assert left.turn == pytest.approx(-kit.tick_m / kit.track_m)
    assert right.turn == pytest.approx(kit.tick_m / kit.track_m)
    assert left.y == right.y == 0.0


def test_motors_of_one_side_share_its_travel(kit):
    factors = motor_factors(kit.differential(), kit.motors((0, 0, 1, 1)))
    assert sum(each.x for each in factors) == pytest.approx(kit.tick_m)
    assert len({round(each.x, 15) for each in factors}) == 1


def test_a_mecanum_base_moves_sideways(kit):
    factors = motor_factors(kit.mecanum(), kit.motors((0, 1, 2, 3)))
    sideways = (-1, 1, -1, 1)
    moved = [
        sum(row[axis] * d for row, d in zip(factors, sideways, strict=True)) for axis in (0, 1, 2)
    ]
    assert moved == pytest.approx([0.0, kit.tick_m, 0.0])


@pytest.mark.parametrize("wheels", [(0, 2), (0, -1)])
def test_a_motor_on_no_wheel_is_refused(kit, wheels):
    with pytest.raises(ConfigError, match="has 2 wheels"):
        motor_factors(kit.differential(), kit.motors(wheels))


def test_a_wheel_without_motor_is_refused(kit):
    with pytest.raises(ConfigError, match="right"):
        motor_factors(kit.differential(), kit.motors((0, 0)))
