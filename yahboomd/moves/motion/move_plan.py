"""Plans moves as legs for a base, or explains why the base cannot drive them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from yahboomd.client.move_messages import Move
from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.base_limits import NARROWEST, Base, turn_limits, way_limits
from yahboomd.moves.motion.lag_model import LagModel
from yahboomd.moves.motion.leg import LOOK_AHEAD_M, BendCaps, CourseLeg, FreeLeg, MoveLeg, TurnLeg
from yahboomd.moves.motion.move_course import (
    TIGHTEST_M,
    Course,
    Point,
    car_path,
    car_path_to_point,
    distinct,
    rounded,
    wrapped,
)
from yahboomd.moves.motion.speed_profile import SpeedLimits, ideal_time_s

CORNER_M = 0.01
NOTHING_M = 1e-4
NOTHING_RAD = math.radians(0.05)
FACES_RAD = math.radians(2.0)
"""A base that faces the way within this angle begins without a turn in place."""

NEAR_M = 0.02
"""A path whose first point is this near begins at the base."""

SLACK = 2.0
"""The aim at a place is 5 mm and 0.5 degrees, of a way or a turn 2 mm and 0.2 degrees."""

FARTHEST_M = 1e7
LEAST_LIMIT, LEAST_RADIUS_M = 1e-3, 1e-3
"""A limit, or the radius of an arc, that is smaller is a mistake."""


class MoveRefused(ValueError):
    """This base cannot drive the move; the text has the reason, and an alternative."""


class PlannedLeg(msgspec.Struct, frozen=True, kw_only=True):
    """A leg of a plan.

    Attributes:
        move: The number of the move that it belongs to.
        course: The course to follow; None for a turn in place.
        begin: The pose at its begin, as planned.
        end: The pose at its end.
        limits: The limits of its speed: along the course, or of the turn in place.
        turn: The limits of turning.
        backward: Whether it is driven backward.
        headings: On a base that moves sideways: the heading by the metres of the course.
        look_ahead_m: As in the move.
        least_radius_m: Of the base.
        slack: How many times the error of a way or a turn is allowed at its end.
    """

    move: int
    course: Course | None
    begin: Pose2d
    end: Pose2d
    limits: SpeedLimits
    turn: SpeedLimits
    backward: bool = False
    headings: tuple[tuple[float, float], ...] = ()
    look_ahead_m: float = LOOK_AHEAD_M
    least_radius_m: float = 0.0
    slack: float = 1.0

    @property
    def length(self) -> float:
        """Metres, or radians of a turn."""
        if self.course is None:
            return abs(self.end.theta - self.begin.theta)
        return self.course.length

    @property
    def time_s(self) -> float:
        """The time of the ideal profile."""
        if self.course is None:
            return ideal_time_s(self.length, self.limits)
        limits = self.limits
        caps = BendCaps(self.course, limits, self.turn)
        cruise_s = sum(
            (end - begin) / max(1e-3, caps.slowest(begin, end))
            for begin, end, _ in self.course.bends()
        )
        return ideal_time_s(self.length, limits) + max(0.0, cruise_s - self.length / limits.speed)

    def drive(self, lag: LagModel, *, last: bool) -> MoveLeg:
        """Make the controller of this leg."""
        if self.course is None:
            return TurnLeg(
                self.limits,
                lag,
                begin=self.begin,
                goal=self.end.theta,
                last=last,
                slack=self.slack,
            )
        if self.headings:
            return FreeLeg(
                self.limits,
                lag,
                course=self.course,
                headings=self.headings,
                turn=self.turn,
                last=last,
                slack=self.slack,
            )
        return CourseLeg(
            self.limits,
            lag,
            course=self.course,
            turn=self.turn,
            backward=self.backward,
            look_ahead_m=self.look_ahead_m,
            least_radius_m=self.least_radius_m,
            last=last,
            slack=self.slack,
        )


def plan(moves: Sequence[Move], begin: Pose2d, base: Base) -> list[PlannedLeg]:
    """The legs of moves in a row, from a pose.

    Each move begins at the planned end of the one before, so that errors do not add up.

    Raises:
        MoveRefused: One of them cannot be driven.
    """
    legs: list[PlannedLeg] = []
    pose = begin
    for number, move in enumerate(moves):
        planner = _Planner(number, move, pose, base)
        try:
            planner.add()
        except MoveRefused as refused:
            which = f"Move {number + 1} of {len(moves)}: " if len(moves) > 1 else ""
            raise MoveRefused(f"{which}{refused}") from None
        legs += planner.legs
        pose = planner.pose
    return legs


class _Planner:
    """Collects the legs of one move."""

    def __init__(self, number: int, move: Move, pose: Pose2d, base: Base) -> None:
        self.legs: list[PlannedLeg] = []
        self.pose = pose
        self._number = number
        self._move = move
        self._base = base
        self._way = way_limits(move, base)
        self._turn = turn_limits(move, base)

    def add(self) -> None:
        move = self._move
        numbers = (move.distance_m, move.left_m, move.angle_rad, move.radius_m)
        given = (move.x or 0.0, move.y or 0.0, move.theta or 0.0)
        flat = [each for point in move.points for each in point]
        if not all(math.isfinite(each) for each in (*numbers, *given, *flat)):
            raise MoveRefused("A number of it is not finite.")
        if any(abs(each) > FARTHEST_M for each in (*given, *flat)):
            raise MoveRefused(f"A goal farther than {FARTHEST_M:g} m is a mistake.")
        limits = (
            *(move.speed_m_s, move.acceleration_m_s2, move.jerk_m_s3, move.look_ahead_m),
            *(move.turn_rad_s, move.acceleration_rad_s2, move.jerk_rad_s3),
        )
        # Written so that a NaN is refused, too.
        if not all(each is None or each >= LEAST_LIMIT for each in limits):
            raise MoveRefused(f"A limit of it below {LEAST_LIMIT:g} is a mistake.")
        self._check_break_away()
        add = {
            "straight": self._straight,
            "turn": self._turn_by,
            "arc": self._arc,
            "go_to": self._go_to,
            "follow": self._follow,
        }[move.kind]
        add()

    def _check_break_away(self) -> None:
        """Refuse a move whose speed does not start this base."""
        ways, _, turns = self._base.slowest
        asked = [
            ("drive", ways, self._way.speed, "m/s", "speed_m_s", "limits.linear.velocity"),
            ("turn", turns, self._turn.speed, "rad/s", "turn_rad_s", "limits.angular.velocity"),
        ]
        kind = self._move.kind
        needed = {"straight": asked[:1], "arc": asked[:1], "turn": asked[1:]}.get(kind, asked)
        for verb, slowest, speed, unit, of_move, limit in needed:
            if speed < slowest:
                raise MoveRefused(
                    f"This robot does not begin to {verb} below {slowest:g} {unit}, as calibrated, "
                    f"and the move is limited to {speed:g} {unit}: ask for a larger {of_move}, or "
                    f"raise {limit}."
                )

    # The moves.

    def _straight(self) -> None:
        ahead, left = self._move.distance_m, self._move.left_m
        if left and not self._base.holonomic:
            raise MoveRefused(
                "left_m needs a base that moves sideways, with mecanum wheels. Turn, and drive "
                "straight."
            )
        if left:
            way = math.hypot(ahead, left)
            direction = self.pose.theta + math.atan2(left, ahead)
            course = Course(_facing(self.pose, direction), [(way, 0.0)])
            self._free(course, self.pose.theta)
        elif abs(ahead) > NOTHING_M:
            backward = ahead < 0.0
            direction = self.pose.theta + (math.pi if backward else 0.0)
            course = Course(_facing(self.pose, direction), [(abs(ahead), 0.0)])
            self._course(course, backward=backward)

    def _turn_by(self) -> None:
        if not self._base.turns:
            raise MoveRefused(
                "A car that steers does not turn in place. Ask for an arc: its tightest has a "
                f"radius of {self._base.least_radius_m:.2f} m."
            )
        self._face(self.pose.theta + self._move.angle_rad)

    def _arc(self) -> None:
        move, base = self._move, self._base
        if move.radius_m < LEAST_RADIUS_M:
            raise MoveRefused("An arc needs radius_m above 0; to turn in place, ask for a turn.")
        if move.radius_m < base.least_radius_m:
            raise MoveRefused(
                f"This car's tightest curve has a radius of {base.least_radius_m:.2f} m, and the "
                f"arc one of {move.radius_m:g} m."
            )
        if not move.angle_rad:
            return
        side = math.copysign(1.0, move.angle_rad)
        direction = self.pose.theta + (math.pi if move.backward else 0.0)
        length = abs(move.angle_rad) * move.radius_m
        course = Course(_facing(self.pose, direction), [(length, side / move.radius_m)])
        self._course(course, backward=move.backward)

    def _go_to(self) -> None:
        move, pose, base = self._move, self.pose, self._base
        if move.x is None or move.y is None:
            raise MoveRefused("go_to needs x and y, in metres.")
        distance = math.hypot(move.x - pose.x, move.y - pose.y)
        theta = None if move.theta is None else pose.theta + wrapped(move.theta - pose.theta)
        if not base.turns:
            self._go_to_by_curves(move.x, move.y, theta, distance)
            return
        if distance > NOTHING_M:
            bearing = math.atan2(move.y - pose.y, move.x - pose.x)
            if base.holonomic:
                course = Course(_facing(pose, bearing), [(distance, 0.0)])
                self._free(course, pose.theta if theta is None else theta)
            else:
                self._towards(bearing, distance, backward=move.backward)
        if theta is not None:
            self._face(self.pose.theta + wrapped(theta - self.pose.theta))

    def _towards(self, bearing: float, distance: float, *, backward: bool) -> None:
        turn = wrapped(bearing - self.pose.theta)
        drives_back = backward and abs(turn) > math.pi / 2.0
        if drives_back:
            turn = wrapped(turn + math.pi)
        self._face(self.pose.theta + turn)
        direction = self.pose.theta + (math.pi if drives_back else 0.0)
        self._course(Course(_facing(self.pose, direction), [(distance, 0.0)]), backward=drives_back)

    def _go_to_by_curves(self, x: float, y: float, theta: float | None, distance: float) -> None:
        if distance <= NOTHING_M and (theta is None or abs(theta - self.pose.theta) <= NOTHING_RAD):
            return
        radius = NARROWEST * self._base.least_radius_m
        ways: list[tuple[float, bool, Course]] = []
        for backward in (False, True) if self._move.backward else (False,):
            shift = math.pi if backward else 0.0
            begin = _facing(self.pose, self.pose.theta + shift)
            pieces = (
                car_path_to_point(begin, x, y, radius)
                if theta is None
                else car_path(begin, Pose2d(x=x, y=y, theta=theta + shift), radius)
            )
            if pieces:
                course = Course(begin, pieces)
                ways.append((course.length, backward, course))
        _, backward, course = min(ways, key=lambda way: way[0])
        self._course(course, backward=backward)

    def _follow(self) -> None:
        move, base, pose = self._move, self._base, self.pose
        points: list[Point] = [(point[0], point[1]) for point in move.points]
        if points and math.dist((pose.x, pose.y), points[0]) > NEAR_M:
            points.insert(0, (pose.x, pose.y))
        points = distinct(points)
        if len(points) < 2:
            raise MoveRefused("follow needs points that are apart: [[x, y], ...] in metres.")
        last = move.points[-1]
        headings = [point for point in move.points if len(point) == 3]
        tightest = max(TIGHTEST_M, NARROWEST * base.least_radius_m)
        corner = CORNER_M if move.corner_m is None else move.corner_m
        courses = rounded(points, corner, tightest)
        if len(courses) > 1 and not base.turns:
            raise MoveRefused(
                "The path has a corner that is too sharp for a car that does not turn in place: "
                f"its curves have a radius of {tightest:.2f} m at least. Set corner_m to how far "
                "corners may be cut, or give a smoother path."
            )
        if headings and base.holonomic:
            for course in courses:
                theta = _heading_at(move.points, course.end.x, course.end.y, self.pose.theta)
                self._free(course, theta)
        else:
            self._face_and_drive(courses)
        if len(last) == 3 and base.turns:
            self._face(self.pose.theta + wrapped(last[2] - self.pose.theta))

    def _face_and_drive(self, courses: list[Course]) -> None:
        backward = False
        first = courses[0].at(0.0).direction
        if self._move.backward:
            backward = abs(wrapped(first - self.pose.theta)) > math.pi / 2.0
        for course in courses:
            shift = math.pi if backward else 0.0
            turn = wrapped(course.at(0.0).direction + shift - self.pose.theta)
            if abs(turn) > FACES_RAD and self._base.turns:
                self._face(self.pose.theta + turn)
            elif abs(turn) > math.pi / 4.0:
                raise MoveRefused(
                    f"The path begins at {math.degrees(turn):.0f} degrees to this car, which does "
                    "not turn in place. Begin it ahead of the car."
                )
            self._course(course, backward=backward)

    # The legs.

    def _face(self, theta: float) -> None:
        end = msgspec.structs.replace(self.pose, theta=theta)
        if abs(theta - self.pose.theta) > NOTHING_RAD:
            self._leg(None, end, limits=self._turn)
        self.pose = end

    def _course(self, course: Course, *, backward: bool) -> None:
        turned = course.end.direction - course.at(0.0).direction
        shift = math.pi if backward else 0.0
        theta = course.at(0.0).direction - shift
        begins = self.pose.theta + wrapped(theta - self.pose.theta)
        end = Pose2d(x=course.end.x, y=course.end.y, theta=begins + turned)
        self._leg(course, end, limits=self._way, backward=backward)
        self.pose = end

    def _free(self, course: Course, theta: float) -> None:
        """A course for a base that moves sideways, with a turn on the way."""
        turn = theta - self.pose.theta
        headings = ((0.0, self.pose.theta), (course.length, theta))
        limits = self._way
        if abs(turn) > NOTHING_RAD:
            # Both ends of the course and of the turn are reached at the same time.
            scale = course.length / abs(turn)
            limits = SpeedLimits(
                speed=min(limits.speed, self._turn.speed * scale),
                acceleration=min(limits.acceleration, self._turn.acceleration * scale),
                braking=min(limits.braking, self._turn.braking * scale),
                jerk=min(limits.jerk, self._turn.jerk * scale),
            )
        end = Pose2d(x=course.end.x, y=course.end.y, theta=theta)
        self._leg(course, end, limits=limits, headings=headings)
        self.pose = end
        if abs(turn) > NOTHING_RAD:
            self._leg(None, end, limits=self._turn)

    def _leg(
        self,
        course: Course | None,
        end: Pose2d,
        *,
        limits: SpeedLimits,
        backward: bool = False,
        headings: tuple[tuple[float, float], ...] = (),
    ) -> None:
        self.legs.append(
            PlannedLeg(
                move=self._number,
                course=course,
                begin=self.pose,
                end=end,
                limits=limits,
                turn=self._turn,
                backward=backward,
                headings=headings,
                look_ahead_m=self._move.look_ahead_m or LOOK_AHEAD_M,
                least_radius_m=self._base.least_radius_m,
                slack=SLACK if self._move.kind == "go_to" else 1.0,
            )
        )


def _facing(pose: Pose2d, direction: float) -> Pose2d:
    return msgspec.structs.replace(pose, theta=direction)


def _heading_at(points: Sequence[tuple[float, ...]], x: float, y: float, theta: float) -> float:
    """The heading of the nearest point that has one, within half a turn of the present heading."""
    given = [point for point in points if len(point) == 3]
    nearest = min(given, key=lambda point: math.hypot(point[0] - x, point[1] - y))
    return theta + wrapped(nearest[2] - theta)
