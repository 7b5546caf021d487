"""The control along one leg, on a base with a lag and nothing else wrong."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from yahboomd.core.model import STANDSTILL, Pose2d, Twist2d
from yahboomd.moves.motion.lag_model import LagModel
from yahboomd.moves.motion.leg import BendCaps, CourseLeg, FreeLeg, MoveLeg, TurnLeg
from yahboomd.moves.motion.move_course import Course
from yahboomd.moves.motion.speed_profile import SpeedLimits, ideal_time_s

WAY = SpeedLimits(speed=0.3, acceleration=0.6, braking=2.4, jerk=4.0)
TURN = SpeedLimits(speed=1.5, acceleration=3.0, braking=12.0, jerk=20.0)
COUNT_M = 0.00016
DT_S = 0.02
WIRE_S = 0.03
MOST_MORE_S = {0.05: 0.7, 0.1: 0.9, 0.2: 1.4, 0.3: 2.8}


class Plant:
    """Every axis follows its command with a lag of the first order, behind a short wire."""

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s
        self.pose = Pose2d()
        self._speed = [0.0, 0.0, 0.0]
        self._wire = [STANDSTILL] * round(WIRE_S / 0.002)

    def advance(self, twist: Twist2d) -> None:
        for _ in range(round(DT_S / 0.002)):
            self._wire.append(twist)
            now = self._wire.pop(0)
            for axis, wanted in enumerate((now.vx, now.vy, now.wz)):
                self._speed[axis] += (wanted - self._speed[axis]) * 0.002 / self._lag_s
            vx, vy, wz = self._speed
            cosine = math.cos(self.pose.theta + wz * 0.001)
            sine = math.sin(self.pose.theta + wz * 0.001)
            self.pose = Pose2d(
                x=self.pose.x + (vx * cosine - vy * sine) * 0.002,
                y=self.pose.y + (vx * sine + vy * cosine) * 0.002,
                theta=self.pose.theta + wz * 0.002,
            )


class Driven:
    """A leg that was driven: its time, its poses, and how far it went past its end."""

    def __init__(
        self, leg: MoveLeg, lag: LagModel, lag_s: float, *, begin: Pose2d | None = None
    ) -> None:
        plant = Plant(lag_s)
        plant.pose = begin or Pose2d()
        self.past = -math.inf
        self.time_s = 0.0
        self.path: list[Pose2d] = []
        self.twists: list[Twist2d] = []
        while (twist := leg.step(plant.pose, DT_S)) is not None:
            lag.command(twist)
            plant.advance(twist)
            lag.advance(DT_S)
            lag.seen(plant.pose)
            self.past = max(self.past, -leg.left(plant.pose))
            self.path.append(plant.pose)
            self.twists.append(twist)
            self.time_s += DT_S
            assert self.time_s < 60.0
        for _ in range(100):
            plant.advance(STANDSTILL)
            lag.command(STANDSTILL)
            lag.advance(DT_S)
        lag.forget_pose()
        self.end = plant.pose


def course(begin: Pose2d, *pieces: tuple[float, float]) -> Course:
    return Course(begin, pieces)


def ahead(way: float, lag: LagModel, *, backward: bool = False) -> CourseLeg:
    begin = Pose2d(theta=math.pi if backward else 0.0)
    return CourseLeg(WAY, lag, course=course(begin, (way, 0.0)), turn=TURN, backward=backward)


@pytest.mark.cases(2)
@pytest.mark.parametrize("lag_s", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("backward", [False, True])
def test_a_straight_ends_at_its_length_in_time_and_without_overshoot(
    lag_s: float, backward: bool
) -> None:
    lag = LagModel()
    Driven(ahead(0.5, lag), lag, lag_s)
    for way in (0.05, 0.3, 1.0):
        driven = Driven(ahead(way, lag, backward=backward), lag, lag_s)
        assert abs(driven.end.x) == pytest.approx(way, abs=0.0014)
        assert (driven.end.x < 0.0) is backward
        assert driven.past <= 3.0 * COUNT_M
        assert driven.time_s <= ideal_time_s(way, WAY) + MOST_MORE_S[lag_s]


@pytest.mark.cases(2)
@pytest.mark.parametrize("lag_s", [0.05, 0.1, 0.2, 0.3])
@pytest.mark.parametrize("angle", [-3.0, -0.3, 0.3, math.pi / 2.0])
def test_a_turn_ends_at_its_angle(lag_s: float, angle: float) -> None:
    lag = LagModel()
    Driven(TurnLeg(TURN, lag, begin=Pose2d(), goal=1.0, last=True), lag, lag_s)
    driven = Driven(TurnLeg(TURN, lag, begin=Pose2d(), goal=angle, last=True), lag, lag_s)
    assert driven.end.theta == pytest.approx(angle, abs=math.radians(0.2))
    assert driven.past <= math.radians(0.25)


@pytest.mark.parametrize("lag_s", [0.05, 0.3])
def test_a_base_beside_its_course_comes_to_it_without_a_swing(lag_s: float) -> None:
    lag = LagModel()
    Driven(ahead(0.5, lag), lag, lag_s)
    leg = CourseLeg(WAY, lag, course=course(Pose2d(), (1.5, 0.0)), turn=TURN, look_ahead_m=0.15)
    driven = Driven(leg, lag, lag_s, begin=Pose2d(y=0.05))
    assert abs(driven.end.y) < 0.002
    assert min(pose.y for pose in driven.path) > -0.004


@pytest.mark.cases(2)
@pytest.mark.parametrize("lag_s", [0.05, 0.1, 0.2, 0.3])
def test_bends_are_followed_within_a_centimetre(lag_s: float) -> None:
    lag = LagModel()
    Driven(ahead(0.5, lag), lag, lag_s)
    wave = course(Pose2d(), (0.3, 0.0), (0.6, 2.5), (0.6, -2.5), (0.3, 0.0))
    leg = CourseLeg(WAY, lag, course=wave, turn=TURN)
    driven = Driven(leg, lag, lag_s)
    way = 0.0
    for pose in driven.path:
        way = wave.nearest(pose, way)
        assert abs(wave.beside(pose, way)[1]) < 0.01
    assert math.hypot(driven.end.x - wave.end.x, driven.end.y - wave.end.y) < 0.005


def test_a_car_is_never_asked_for_a_tighter_curve_than_it_steers() -> None:
    lag = LagModel()
    leg = CourseLeg(
        WAY,
        lag,
        course=course(Pose2d(), (0.5, 1.0 / 0.3), (0.5, 0.0)),
        turn=TURN,
        least_radius_m=0.25,
    )
    driven = Driven(leg, lag, 0.1, begin=Pose2d(y=0.1, theta=-0.5))
    assert any(twist.wz for twist in driven.twists)
    assert all(abs(t.wz) <= abs(t.vx) / 0.25 + 1e-9 for t in driven.twists)


@pytest.mark.parametrize("lag_s", [0.05, 0.2])
@pytest.mark.parametrize("direction", [0.0, math.pi / 2.0, -2.5])
def test_a_free_base_turns_on_its_way(lag_s: float, direction: float) -> None:
    lag = LagModel()
    Driven(ahead(0.5, lag), lag, lag_s)
    way = course(Pose2d(theta=direction), (0.8, 0.0))
    leg = FreeLeg(WAY, lag, course=way, headings=((0.0, 0.0), (0.8, 1.2)), turn=TURN)
    driven = Driven(leg, lag, lag_s)
    assert math.hypot(driven.end.x - way.end.x, driven.end.y - way.end.y) < 0.003
    assert driven.end.theta == pytest.approx(1.2, abs=0.02)
    middle = min(driven.path, key=lambda pose: abs(math.hypot(pose.x, pose.y) - 0.4))
    assert middle.theta == pytest.approx(0.6, abs=0.06)


def test_a_turn_comes_back_to_its_place() -> None:
    lag = LagModel()
    leg = TurnLeg(TURN, lag, begin=Pose2d(), goal=math.pi / 2.0, last=True)
    driven = Driven(leg, lag, 0.1, begin=Pose2d(x=0.012))
    assert math.hypot(driven.end.x, driven.end.y) < 0.005


def test_held_it_comes_to_rest_within_its_acceleration_and_goes_on() -> None:
    lag, plant = LagModel(), Plant(0.1)
    leg = ahead(1.0, lag)
    speeds = [0.0]
    for step in range(400):
        twist = leg.step(plant.pose, DT_S, hold=100 < step < 300)
        if twist is None:
            break
        lag.command(twist)
        plant.advance(twist)
        lag.advance(DT_S)
        lag.seen(plant.pose)
        speeds.append(twist.vx)
    steps = [b - a for a, b in pairwise(speeds)]
    assert min(steps[:290]) >= -0.6 * DT_S - 1e-6
    assert speeds[200:300] == [0.0] * 100
    assert max(speeds[310:]) > 0.1


def test_the_speed_is_lower_in_a_bend_and_before_it() -> None:
    caps = BendCaps(course(Pose2d(), (1.0, 0.0), (0.3, 10.0), (1.0, 0.0)), WAY, TURN)
    assert caps.at(0.1) == 0.3
    assert caps.at(1.1) == pytest.approx(0.15)
    entry = 3.0 * 0.15 / 10.0
    assert caps.at(0.99) == pytest.approx(math.sqrt(entry**2 + 1.4 * 0.6 * 0.01))
    assert entry < caps.at(0.95) < caps.at(0.9) <= 0.3


def test_one_that_is_not_the_last_does_not_wait() -> None:
    lag = LagModel()
    first = TurnLeg(TURN, lag, begin=Pose2d(), goal=1.0, last=False)
    last = TurnLeg(TURN, lag, begin=Pose2d(), goal=1.0, last=True)
    assert Driven(first, lag, 0.1).time_s < Driven(last, LagModel(), 0.1).time_s


def test_a_leg_may_be_passed_while_the_base_rolls_to_about_its_end() -> None:
    lag = LagModel()
    leg = ahead(0.08, lag)
    assert leg.is_near(Pose2d(x=0.073), 1.0)
    assert not leg.is_near(Pose2d(x=0.071), 1.0)
    # Of a command of 0.1 m/s some way is under way; the first time a model is no surer than this.
    lag.command(Twist2d(vx=0.1))
    lag.advance(0.3)
    lag.command(STANDSTILL)
    rolls = 1.25 * lag.under_way[0]
    assert 0.01 < rolls < 0.024
    assert leg.is_near(Pose2d(x=0.08 - rolls), 1.0)
    assert not leg.is_near(Pose2d(x=0.08 + 0.009 - rolls), 1.0)
    # However sure of it: not from this far.
    lag.command(Twist2d(vx=0.3))
    lag.advance(1.0)
    assert lag.under_way[0] > 0.03
    assert not leg.is_near(Pose2d(x=0.08 - 1.25 * lag.under_way[0]), 1.0)


@pytest.mark.parametrize(("slack", "within"), [(1.0, 0.0013), (2.0, 0.0026)])
def test_with_slack_a_leg_may_end_farther_off(slack: float, within: float) -> None:
    ends = []
    for left in (within - 1e-5, within + 1e-5):
        leg = CourseLeg(
            WAY, LagModel(), course=course(Pose2d(), (0.1, 0.0)), turn=TURN, slack=slack
        )
        leg._landed = True
        steps = [leg.step(Pose2d(x=0.1 - left), DT_S) for _ in range(20)]
        ends.append(None in steps and all(twist in {None, STANDSTILL} for twist in steps))
    assert ends == [True, False]


def test_a_base_far_from_its_end_is_short() -> None:
    leg = ahead(0.05, LagModel())
    assert leg.short_by(Pose2d(x=0.04)) == "10.0 mm"
    assert leg.short_by(Pose2d(x=0.049)) == ""
