"""The shortest ways of a car."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.move_course import Course, car_path, car_path_to_point, wrapped

RADIUS_M = 0.25
places = st.floats(-2.0, 2.0)
angles = st.floats(-math.pi, math.pi)
poses = st.builds(Pose2d, x=places, y=places, theta=angles)


@given(poses, poses)
def test_they_end_at_the_goal_in_curves_that_the_car_can_drive(begin: Pose2d, goal: Pose2d) -> None:
    pieces = car_path(begin, goal, RADIUS_M)
    end = Course(begin, pieces or [(0.0, 0.0)]).end
    assert math.hypot(end.x - goal.x, end.y - goal.y) < 1e-4
    assert abs(wrapped(end.direction - goal.theta)) < 1e-4
    assert all(abs(k) <= 1.0 / RADIUS_M + 1e-9 for _, k in pieces)
    length = sum(length for length, _ in pieces)
    # Never shorter than the straight line, nor longer than it and the two turns.
    distance = math.hypot(goal.x - begin.x, goal.y - begin.y)
    assert distance - 1e-6 <= length <= distance + 4.0 * math.pi * RADIUS_M + 1e-6


def test_straight_ahead_is_straight() -> None:
    assert car_path(Pose2d(), Pose2d(x=2.0), RADIUS_M) == [(pytest.approx(2.0), 0.0)]


def test_a_point_is_reached_with_any_heading_by_a_shorter_way() -> None:
    pieces = car_path_to_point(Pose2d(), 0.0, 1.0, RADIUS_M)
    end = Course(Pose2d(), pieces).end
    assert math.hypot(end.x, end.y - 1.0) < 1e-6
    any_way = sum(length for length, _ in pieces)
    straight_on = sum(length for length, _ in car_path(Pose2d(), Pose2d(y=1.0), RADIUS_M))
    assert any_way < straight_on - 0.1
