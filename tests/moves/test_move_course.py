"""Lines and arcs in a row."""

from __future__ import annotations

import math

import pytest

from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.move_course import Course, wrapped

QUARTER = Course(Pose2d(), [(1.0, 0.0), (math.pi / 4.0, 2.0), (0.5, 0.0)])
"""A metre ahead, a quarter to the left with a radius of 0.5 m, half a metre."""


def test_pieces_follow_each_other() -> None:
    assert QUARTER.length == pytest.approx(1.5 + math.pi / 4.0)
    end = QUARTER.end
    assert (end.x, end.y) == pytest.approx((1.5, 1.0))
    assert end.direction == pytest.approx(math.pi / 2.0)
    middle = QUARTER.at(1.0 + math.pi / 8.0)
    assert middle.x == pytest.approx(1.0 + 0.5 * math.sin(math.pi / 4.0))
    assert middle.curvature == 2.0


def test_before_and_behind_it_goes_straight_on() -> None:
    assert QUARTER.at(-0.2).x == pytest.approx(-0.2)
    behind = QUARTER.at(QUARTER.length + 0.3)
    assert (behind.x, behind.y) == pytest.approx((1.5, 1.3))
    assert behind.curvature == 0.0


@pytest.mark.parametrize("way", [0.1, 0.98, 1.2, 1.7, 2.2])
@pytest.mark.parametrize("left", [-0.05, 0.0, 0.08])
def test_the_nearest_place_of_a_pose_beside_it(way: float, left: float) -> None:
    point = QUARTER.at(way)
    pose = Pose2d(
        x=point.x - left * math.sin(point.direction), y=point.y + left * math.cos(point.direction)
    )
    found = QUARTER.nearest(pose, way - 0.04)
    assert found == pytest.approx(way, abs=2e-3)
    ahead, beside, _ = QUARTER.beside(pose, found)
    assert abs(ahead) < 2e-3
    assert beside == pytest.approx(left, abs=1e-3)


def test_a_course_that_crosses_itself_is_driven_in_order() -> None:
    eight = Course(Pose2d(), [(math.pi, 2.0), (math.pi, -2.0)])
    way = 0.0
    while way < eight.length - 0.05:
        point = eight.at(way + 0.05)
        found = eight.nearest(Pose2d(x=point.x, y=point.y), way)
        assert found == pytest.approx(way + 0.05, abs=1e-3)
        way = found


def test_pieces_without_length_are_left_away() -> None:
    assert len(Course(Pose2d(), [(1.0, 0.0), (0.0, 3.0), (1.0, 0.0)]).bends()) == 2


def test_angles_are_wrapped() -> None:
    assert wrapped(3.0 * math.pi + 0.1) == pytest.approx(-math.pi + 0.1)
