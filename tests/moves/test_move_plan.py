"""Moves to legs, for each geometry; and what a base refuses."""

from __future__ import annotations

import math
from typing import Any

import pytest

from yahboomd.client.move_messages import Move
from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.base_limits import Base
from yahboomd.moves.motion.move_plan import MoveRefused, PlannedLeg, plan
from yahboomd.moves.motion.speed_profile import SpeedLimits

WIDE = SpeedLimits(speed=1.0, acceleration=2.5, braking=5.0, jerk=math.inf)
TURN = SpeedLimits(speed=6.0, acceleration=12.0, braking=24.0, jerk=math.inf)
TWO = Base(way=WIDE, turn=TURN)
MECANUM = Base(holonomic=True, way=WIDE, turn=TURN)
CAR = Base(least_radius_m=0.2, way=WIDE, turn=TURN)
HERE = Pose2d(x=1.0, y=2.0, theta=math.pi / 2.0)


def legs(base: Base, **move: Any) -> list[PlannedLeg]:
    return plan([Move(**move)], HERE, base)


def kinds(planned: list[PlannedLeg]) -> list[str]:
    return ["turn" if leg.course is None else "way" for leg in planned]


def at(pose: Pose2d) -> tuple[float, float, float]:
    return pose.x, pose.y, pose.theta


@pytest.mark.parametrize("way", [0.7, -0.7])
def test_straight_goes_along_the_heading_either_way(way: float) -> None:
    (leg,) = legs(TWO, kind="straight", distance_m=way)
    assert at(leg.end) == pytest.approx((1.0, 2.0 + way, math.pi / 2.0))
    assert leg.backward is (way < 0.0)


def test_a_turn_ends_at_its_angle_however_large() -> None:
    (leg,) = legs(TWO, kind="turn", angle_rad=-7.0)
    assert leg.end.theta == pytest.approx(math.pi / 2.0 - 7.0)


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize("angle", [1.0, -1.0])
def test_an_arc_turns_the_base_by_its_angle(angle: float, backward: bool) -> None:
    (leg,) = legs(CAR, kind="arc", radius_m=0.5, angle_rad=angle, backward=backward)
    assert leg.end.theta == pytest.approx(math.pi / 2.0 + angle)
    ahead = leg.end.y - 2.0
    assert ahead == pytest.approx((-1 if backward else 1) * 0.5 * math.sin(1.0))
    assert leg.length == pytest.approx(0.5)


def test_go_to_turns_drives_and_turns() -> None:
    planned = legs(TWO, kind="go_to", x=2.0, y=2.0, theta=0.5)
    assert kinds(planned) == ["turn", "way", "turn"]
    assert at(planned[-1].end) == pytest.approx((2.0, 2.0, 0.5))
    assert kinds(legs(TWO, kind="go_to", x=2.0, y=2.0)) == ["turn", "way"]


def test_go_to_drives_backward_only_if_that_is_allowed_and_turns_less() -> None:
    (leg,) = legs(TWO, kind="go_to", x=1.0, y=1.0, backward=True)
    assert leg.backward
    assert kinds(legs(TWO, kind="go_to", x=1.0, y=1.0)) == ["turn", "way"]
    (ahead,) = legs(TWO, kind="go_to", x=1.0, y=3.0, backward=True)
    assert not ahead.backward


def test_on_mecanum_go_to_is_one_way_with_the_turn_on_it() -> None:
    planned = legs(MECANUM, kind="go_to", x=2.0, y=2.0, theta=0.0)
    assert kinds(planned) == ["way", "turn"]
    assert planned[0].headings[-1][1] == pytest.approx(0.0)
    assert planned[1].length == 0.0
    # The turn is as long as the way: a fast way would turn too fast.
    slow = legs(MECANUM, kind="go_to", x=1.02, y=2.0, theta=-1.0)[0]
    assert slow.limits.speed < 0.03


def test_sideways_needs_mecanum() -> None:
    (leg,) = legs(MECANUM, kind="straight", left_m=0.5)
    assert at(leg.end) == pytest.approx((0.5, 2.0, math.pi / 2.0))
    with pytest.raises(MoveRefused, match="mecanum"):
        legs(TWO, kind="straight", left_m=0.5)


def test_a_car_refuses_a_turn_in_place_and_a_curve_that_it_cannot_steer() -> None:
    with pytest.raises(MoveRefused, match=r"radius of 0\.20 m"):
        legs(CAR, kind="turn", angle_rad=1.0)
    with pytest.raises(MoveRefused, match=r"0\.20 m, and the arc one of 0\.1 m"):
        legs(CAR, kind="arc", radius_m=0.1, angle_rad=1.0)


@pytest.mark.parametrize("theta", [None, 0.0, -2.0])
@pytest.mark.parametrize("backward", [False, True])
def test_a_car_goes_there_in_curves_that_it_can_drive(theta: float | None, backward: bool) -> None:
    (leg,) = legs(CAR, kind="go_to", x=1.5, y=1.0, theta=theta, backward=backward)
    assert leg.course is not None
    assert (leg.end.x, leg.end.y) == pytest.approx((1.5, 1.0), abs=1e-6)
    if theta is not None:
        assert math.remainder(leg.end.theta - theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    assert all(abs(k) < 1.0 / 0.2 for _, _, k in leg.course.bends())


def test_a_path_with_a_sharp_corner_is_turned_at_and_a_car_refuses_it() -> None:
    corner = ((1.0, 3.0), (2.0, 3.0))
    assert kinds(legs(TWO, kind="follow", points=corner)) == ["way", "turn", "way"]
    assert kinds(legs(TWO, kind="follow", points=corner, corner_m=0.1)) == ["way"]
    with pytest.raises(MoveRefused, match="corner_m"):
        legs(CAR, kind="follow", points=corner)
    assert kinds(legs(CAR, kind="follow", points=corner, corner_m=0.2)) == ["way"]


def test_a_path_begins_at_the_base_and_is_faced_first() -> None:
    planned = legs(TWO, kind="follow", points=((2.0, 2.0), (3.0, 2.0, 1.0)))
    assert kinds(planned) == ["turn", "way", "turn"]
    assert planned[1].length == pytest.approx(2.0)
    assert planned[-1].end.theta == pytest.approx(1.0)
    with pytest.raises(MoveRefused, match="does not turn in place"):
        legs(CAR, kind="follow", points=((2.0, 2.0), (3.0, 2.0)))


def test_headings_on_mecanum_are_those_of_the_points() -> None:
    planned = legs(MECANUM, kind="follow", points=((1.0, 3.0, 0.0), (2.0, 3.0, 1.0)))
    ways = [leg for leg in planned if leg.course is not None]
    assert [leg.headings[-1][1] for leg in ways] == pytest.approx([0.0, 1.0])


def test_moves_in_a_row_begin_where_the_one_before_ends() -> None:
    side = [Move(kind="straight", distance_m=1.0), Move(kind="turn", angle_rad=math.pi / 2.0)]
    planned = plan(side * 4, HERE, TWO)
    assert at(planned[-1].end) == pytest.approx((1.0, 2.0, math.pi / 2.0 + 2.0 * math.pi))
    assert [leg.move for leg in planned] == list(range(8))


def test_a_refusal_names_the_move() -> None:
    with pytest.raises(MoveRefused, match=r"^Move 2 of 2: go_to needs x and y"):
        plan([Move(kind="straight", distance_m=1.0), Move(kind="go_to", x=1.0)], HERE, TWO)


@pytest.mark.parametrize(
    "move",
    [
        {"kind": "straight", "distance_m": math.nan},
        {"kind": "go_to", "x": math.inf, "y": 0.0},
        {"kind": "go_to", "x": 1e9, "y": 0.0},
        {"kind": "follow", "points": ((1.0, 2.0),)},
        {"kind": "follow"},
        {"kind": "arc", "angle_rad": 1.0},
    ],
)
def test_what_cannot_be_meant_is_refused(move: dict[str, Any]) -> None:
    with pytest.raises(MoveRefused):
        legs(TWO, **move)


def test_moves_that_change_nothing_have_no_legs() -> None:
    assert legs(TWO, kind="straight", distance_m=0.0) == []
    assert legs(TWO, kind="turn", angle_rad=0.0) == []
    assert legs(TWO, kind="go_to", x=1.0, y=2.0) == []
    assert legs(CAR, kind="go_to", x=1.0, y=2.0) == []


def test_the_time_of_a_path_counts_its_bends() -> None:
    tight = tuple((1.0 + 0.1 * math.sin(0.2 * i), 2.1 - 0.1 * math.cos(0.2 * i)) for i in range(30))
    plain = legs(TWO, kind="straight", distance_m=0.58)[0].time_s
    assert legs(TWO, kind="follow", points=tight)[-1].time_s > plain + 0.2
