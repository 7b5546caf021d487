"""One leg of a move: a turn in place, or a course that is driven without a stop.

The control acts on the predicted pose (:mod:`yahboomd.moves.motion.lag_model`), for which a base
has no lag. Along the leg it is the speed profile. Across it, wheels that cannot move sideways drive
the curvature ``k - e / l^2 - 2 sin(a) / l``: k of the course, e the distance to its left, a the
angle to it, l the look-ahead. So e decays without a swing, with both poles at 1/l per metre, as in
the linear path following of Samson (*Control of chained systems*, IEEE TAC 1995).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.model import STANDSTILL, Pose2d, Twist2d
from yahboomd.moves.motion.lag_model import ROLL, LagModel, in_base
from yahboomd.moves.motion.landing import Landing, Tolerance, pushed
from yahboomd.moves.motion.move_course import Course, wrapped
from yahboomd.moves.motion.speed_profile import SpeedLimits, next_speed

Axis: TypeAlias = Literal[0, 1, 2]
"""An axis of the lag model: ahead, to the left, turned."""

LOOK_AHEAD_M = 0.12

WAY = Tolerance(
    end=0.0013,
    aim=0.0004,
    short=0.005,
    near=0.008,
    least=0.002,
    still=0.0003,
    creep=0.012,
    pulse=0.035,
)
TURN = Tolerance(
    end=math.radians(0.15),
    aim=math.radians(0.045),
    short=math.radians(1.0),
    near=math.radians(3.0),
    least=math.radians(0.4),
    still=math.radians(0.09),
    creep=0.12,
    pulse=0.35,
)
FREE = msgspec.structs.replace(WAY, near=WAY.least)
"""A turn in place that follows cannot correct an error to the side."""

ACROSS_PER_S = 4.0
"""The decay rate of errors across the course and of the heading, for a base that moves sideways."""

ROLLS = 2.0
"""How many times that far a base may still be from the end of a leg when the next one begins."""

KEEP_PER_S, KEEP_M_S, KEEPS_M = 4.0, 0.06, 0.05
"""How fast a base that turns comes back to its place; in corrections, by the turning speed."""

BEND_S = 0.15
"""The time that the turning speed may take to change from one bend to the next."""

SLOWING = 1.4
"""Twice the deceleration before a bend, as a share of the limit: v^2 = 2 a s."""


class MoveLeg:
    """A leg being driven.

    It drives until the base will roll to its end, and then corrects the rest.

    Args:
        limits: The limits of the speed along it.
        lag: The model of the base; the same for all legs.
        tolerance: The tolerances of its end.
        axis: The axis along which it is driven.
        last: Whether the base has to stand at its end.
        slack: How many times the largest remaining error is allowed.
    """

    def __init__(
        self,
        limits: SpeedLimits,
        lag: LagModel,
        *,
        tolerance: Tolerance,
        axis: Axis,
        last: bool,
        slack: float,
    ) -> None:
        self.limits = limits
        self._slowest = max(tolerance.creep, lag.slowest[axis])
        self._last = last
        self._lag = lag
        self._axis: Axis = axis
        self._tolerance = msgspec.structs.replace(tolerance, end=slack * tolerance.end)
        self._speed = 0.0
        self._rate = 0.0
        self._landed = False
        self._landing = Landing(self._tolerance, lag.rolls[axis], lag.slowest[axis], limits.speed)

    @property
    def lands(self) -> bool:
        """Whether it only corrects the rest."""
        return self._landed

    def left(self, pose: Pose2d) -> float:
        """The rest of the leg from a pose; negative behind its end."""
        raise NotImplementedError

    def _most(self, _left: float) -> float:
        """The largest speed here."""
        return self.limits.speed

    def _twist(self, speed: float, predicted: Pose2d) -> Twist2d:
        """The velocity for a speed along the leg."""
        raise NotImplementedError

    def _way(self, ahead: float, left: float, turned: float) -> float:
        """A way of the base along the leg."""
        raise NotImplementedError

    def step(self, pose: Pose2d, dt_s: float, *, hold: bool = False) -> Twist2d | None:
        """The velocity to command until the next step; None once the leg is over.

        Args:
            pose: The newest pose.
            dt_s: The time until the next step.
            hold: Come to rest on the way, and stay.
        """
        predicted = self._lag.predicted(pose)
        if hold:
            gentle = msgspec.structs.replace(self.limits, braking=self.limits.acceleration)
            self._speed, self._rate = next_speed(
                self._speed, self._rate, dt_s, left=0.0, most=0.0, limits=gentle
            )
            return self._twist(self._speed, predicted)
        if not self._landed:
            swing = self._way(*self._lag.swing)
            left = self.left(self._lag.predicted(pose, ROLL)) - max(0.0, swing)
            self._landed = left <= self._lag.rolls[self._axis].landing + self._tolerance.still
            if not self._landed:
                return self._twist(self._towards(left, dt_s), predicted)
            self._speed = self._rate = 0.0
        if not self._last:
            return None
        rolling = self._way(*self._lag.under_way)
        speed = self._landing.step(self.left(pose), rolling, dt_s, self._lag.motor_s)
        return None if speed is None else self._twist(speed, predicted)

    def _towards(self, left: float, dt_s: float) -> float:
        self._speed, self._rate = next_speed(
            self._speed,
            self._rate,
            dt_s,
            left=left,
            most=self._most(left),
            limits=self.limits,
            landing_per_s=self._lag.landing_per_s,
        )
        floor = self._tolerance.creep
        if self._lag.stands:
            floor = max(floor, pushed(self._slowest, self._lag.stood_s, self.limits.speed))
        return max(self._speed, min(floor, left / dt_s))

    def is_near(self, pose: Pose2d, room: float) -> bool:
        """Whether the base rolls to about its end, and is nearly there.

        Args:
            room: How much of the rest the next leg can correct: from 0 for none to 1 for all of it.
        """
        tolerance = self._tolerance
        near = tolerance.least + room * (tolerance.near - tolerance.least)
        rest = self.left(self._lag.predicted(pose, ROLL))
        # What it still rolls is corrected too, and less surely known.
        return abs(rest) <= near and abs(self.left(pose)) <= (1.0 + ROLLS * room) * near

    def short_by(self, pose: Pose2d) -> str:
        """How far from its end it ended after all corrections; empty if near enough."""
        left = abs(self.left(pose))
        return f"{1000.0 * left:.1f} mm" if left > self._tolerance.short else ""


class TurnLeg(MoveLeg):
    """A turn in place.

    One wheel may begin before the other: the base drives back the way ahead that results.

    Args:
        begin: The pose at its begin: the place to be kept.
        goal: The heading at its end, not wrapped.
    """

    def __init__(
        self,
        limits: SpeedLimits,
        lag: LagModel,
        *,
        begin: Pose2d,
        goal: float,
        last: bool = True,
        slack: float = 1.0,
    ) -> None:
        super().__init__(limits, lag, tolerance=TURN, axis=2, last=last, slack=slack)
        self._begin = begin
        self._goal = goal
        self._sign = math.copysign(1.0, goal - begin.theta)

    def left(self, pose: Pose2d) -> float:
        return self._sign * (self._goal - pose.theta)

    def short_by(self, pose: Pose2d) -> str:
        left = abs(self.left(pose))
        return f"{math.degrees(left):.2f} degrees" if left > self._tolerance.short else ""

    def _way(self, _ahead: float, _left: float, turned: float) -> float:
        return self._sign * turned

    def _twist(self, speed: float, predicted: Pose2d) -> Twist2d:
        if not speed:
            return STANDSTILL
        vx = 0.0
        if not self._landed or self._lag.rolls[2].sticks:
            dx, dy = self._begin.x - predicted.x, self._begin.y - predicted.y
            ahead, _ = in_base(dx, dy, predicted.theta)
            most = min(KEEP_M_S, KEEPS_M * abs(speed)) if self._landed else KEEP_M_S
            vx = max(-most, min(most, KEEP_PER_S * ahead))
        return Twist2d(vx=vx, wz=self._sign * speed)


class CourseLeg(MoveLeg):
    """A course, driven by wheels that cannot move sideways.

    Args:
        backward: Whether the base drives it backward.
        turn: The limits of turning.
        look_ahead_m: The way in metres over which an error across it decays.
        least_radius_m: The tightest curve of the base.
    """

    def __init__(
        self,
        limits: SpeedLimits,
        lag: LagModel,
        *,
        course: Course,
        turn: SpeedLimits,
        backward: bool = False,
        look_ahead_m: float = LOOK_AHEAD_M,
        least_radius_m: float = 0.0,
        last: bool = True,
        slack: float = 1.0,
    ) -> None:
        super().__init__(limits, lag, tolerance=WAY, axis=0, last=last, slack=slack)
        self._course = course
        self._sign = -1.0 if backward else 1.0
        self._reach = look_ahead_m
        self._most_curvature = 1.0 / least_radius_m if least_radius_m else math.inf
        self._turn = turn
        self._caps = BendCaps(course, limits, turn)
        self._at = 0.0

    def left(self, pose: Pose2d) -> float:
        return self._course.length - self._course.nearest(pose, self._at)

    def _most(self, left: float) -> float:
        return self._caps.at(self._course.length - left)

    def _way(self, ahead: float, _left: float, _turned: float) -> float:
        return self._sign * ahead

    def _twist(self, speed: float, predicted: Pose2d) -> Twist2d:
        self._at = self._course.nearest(predicted, self._at)
        if speed == 0.0:
            return STANDSTILL
        if speed < 0.0:
            # A short way back is driven straight.
            return Twist2d(vx=self._sign * speed)
        _, left, point = self._course.beside(predicted, self._at)
        travel = predicted.theta + (math.pi if self._sign < 0.0 else 0.0)
        angle = wrapped(travel - point.direction)
        curvature = point.curvature - left / self._reach**2 - 2.0 * math.sin(angle) / self._reach
        most = min(self._most_curvature, self._turn.speed / speed)
        return Twist2d(vx=self._sign * speed, wz=speed * max(-most, min(most, curvature)))


class FreeLeg(MoveLeg):
    """A course, driven by wheels that move sideways, with a heading of its own at each place.

    Args:
        headings: The heading at places of the course, by their metres; at least the two ends.
    """

    def __init__(
        self,
        limits: SpeedLimits,
        lag: LagModel,
        *,
        course: Course,
        headings: Sequence[tuple[float, float]],
        turn: SpeedLimits,
        last: bool = True,
        slack: float = 1.0,
    ) -> None:
        begin, first = course.at(0.0), headings[0][1]
        sideways = abs(math.sin(begin.direction - first)) > math.sqrt(0.5)
        super().__init__(
            limits, lag, tolerance=FREE, axis=1 if sideways else 0, last=last, slack=slack
        )
        self._course = course
        self._headings = list(headings)
        self._caps = BendCaps(course, limits, turn)
        self._turn = turn
        self._at = 0.0
        self._theta = first

    def left(self, pose: Pose2d) -> float:
        return self._course.length - self._course.nearest(pose, self._at)

    def _most(self, left: float) -> float:
        return self._caps.at(self._course.length - left)

    def _way(self, ahead: float, left: float, _turned: float) -> float:
        angle = self._course.at(self._at).direction - self._theta
        return ahead * math.cos(angle) + left * math.sin(angle)

    def _heading(self) -> tuple[float, float]:
        """The heading here, and how much it changes in a metre."""
        places = [way for way, _ in self._headings]
        index = max(1, min(len(places) - 1, bisect_right(places, self._at)))
        (way, theta), (end, after) = self._headings[index - 1], self._headings[index]
        slope = (after - theta) / (end - way) if end > way else 0.0
        within = max(0.0, min(end - way, self._at - way))
        inside = 0.0 <= self._at < self._course.length
        return theta + slope * within, slope if inside else 0.0

    def _twist(self, speed: float, predicted: Pose2d) -> Twist2d:
        self._at = self._course.nearest(predicted, self._at)
        self._theta = predicted.theta
        _, left, point = self._course.beside(predicted, self._at)
        theta, slope = self._heading()
        if speed == 0.0 and self._landed:
            return STANDSTILL
        cosine, sine = math.cos(point.direction), math.sin(point.direction)
        across = -ACROSS_PER_S * left
        vx, vy = in_base(
            speed * cosine - across * sine, speed * sine + across * cosine, predicted.theta
        )
        wz = slope * speed + ACROSS_PER_S * (theta - predicted.theta)
        most = self._turn.speed
        return Twist2d(vx=vx, vy=vy, wz=max(-most, min(most, wz)))


class BendCaps:
    """The speed that bends allow, at each place of a course.

    In a bend, the turning speed and the sideways acceleration are limited; from one bend to the
    next the turning speed cannot jump.
    """

    def __init__(self, course: Course, limits: SpeedLimits, turn: SpeedLimits) -> None:
        bends = course.bends()
        self._starts = [begin for begin, _, _ in bends]
        self._ends = [end for _, end, _ in bends]
        self._slowing = SLOWING * limits.acceleration
        self._within = [
            min(limits.speed, turn.speed / abs(k), math.sqrt(limits.acceleration / abs(k)))
            if k
            else limits.speed
            for _, _, k in bends
        ]
        self._entries = list(self._within)
        before = [0.0, *(k for _, _, k in bends)]
        for index, (one, other) in enumerate(pairwise(before)):
            if one != other:
                jump = turn.acceleration * BEND_S / abs(other - one)
                self._entries[index] = min(self._entries[index], jump)
        for index in range(len(bends) - 2, -1, -1):
            length = self._ends[index] - self._starts[index]
            after = math.sqrt(self._entries[index + 1] ** 2 + self._slowing * length)
            self._entries[index] = min(self._entries[index], after)

    def at(self, way: float) -> float:
        """The largest speed at a place, with which the bends ahead can be met."""
        index = max(0, bisect_right(self._starts, way) - 1)
        most = self._within[index]
        if index + 1 < len(self._entries):
            ahead = max(0.0, self._ends[index] - way)
            most = min(most, math.sqrt(self._entries[index + 1] ** 2 + self._slowing * ahead))
        return most

    def slowest(self, begin: float, end: float) -> float:
        """The mean speed allowed over a stretch, for an estimate of its time."""
        steps = 8
        return sum(self.at(begin + (end - begin) * i / steps) for i in range(steps)) / steps
