"""Courses: lines and arcs in a row, with the place along them that is nearest to a pose.

They are made of points, whose corners become arcs or stops, and of a car's shortest way from pose
to pose.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence

import msgspec

from yahboomd.core.model import Pose2d

STEPS = 4
"""Steps of the search for the nearest place; it begins at the latest one, so one or two suffice."""

LEAST_M = 1e-9
"""Shorter pieces are ignored."""

REACH_M = 0.1
"""The nearest place is at most this far from the latest one: a course may cross itself."""


TIGHTEST_M = 0.05
"""An arc with a smaller radius is a corner at which a base stops."""

SAME_POINT_M = 1e-4

Point = tuple[float, float]

HEADINGS = 180
"""The number of headings compared for a goal that allows any heading."""

Pieces = list[tuple[float, float]]


class CoursePoint(msgspec.Struct, frozen=True, kw_only=True):
    """A place of a course.

    Attributes:
        x: Metres.
        y: Metres.
        direction: The direction of the course, rad, not wrapped within a course.
        curvature: The curvature of the course, 1/m; positive to the left.
    """

    x: float
    y: float
    direction: float
    curvature: float


class CoursePiece(msgspec.Struct, frozen=True, kw_only=True):
    """A line or an arc.

    Attributes:
        start: Its first point, with its curvature.
        length: Metres.
    """

    start: CoursePoint
    length: float

    def at(self, way: float) -> CoursePoint:
        """The point after this many metres; outside of the piece, its line or arc continues."""
        start = self.start
        half = start.curvature * way / 2.0
        chord = way * (math.sin(half) / half if abs(half) > 1e-6 else 1.0)
        return CoursePoint(
            x=start.x + chord * math.cos(start.direction + half),
            y=start.y + chord * math.sin(start.direction + half),
            direction=start.direction + 2.0 * half,
            curvature=start.curvature,
        )


class Course:
    """Pieces in a row.

    Args:
        begin: Its first point and direction.
        pieces: Length and curvature of each, in metres and 1/m.
    """

    def __init__(self, begin: Pose2d, pieces: Sequence[tuple[float, float]]) -> None:
        self._starts: list[float] = []
        self._pieces: list[CoursePiece] = []
        self.length = 0.0
        point = CoursePoint(x=begin.x, y=begin.y, direction=begin.theta, curvature=0.0)
        for length, curvature in pieces:
            if length <= LEAST_M and self._pieces:
                continue
            piece = CoursePiece(
                start=msgspec.structs.replace(point, curvature=curvature), length=length
            )
            self._starts.append(self.length)
            self._pieces.append(piece)
            self.length += length
            point = piece.at(length)
        self.end = point

    def at(self, way: float) -> CoursePoint:
        """The point after this many metres. Outside of the course, it continues straight."""
        if way >= self.length or way < 0.0:
            from_end = way >= self.length
            edge = self.end if from_end else self._pieces[0].start
            over = way - self.length if from_end else way
            return CoursePiece(start=msgspec.structs.replace(edge, curvature=0.0), length=0.0).at(
                over
            )
        index = bisect_right(self._starts, way) - 1
        return self._pieces[index].at(way - self._starts[index])

    def nearest(self, pose: Pose2d, way: float) -> float:
        """The metres at the place nearest to a pose; searched around ``way``."""
        found = way
        for _ in range(STEPS):
            ahead, left, point = self.beside(pose, found)
            # On an arc, the foot point moves farther or less far than the pose.
            stretch = max(0.2, 1.0 - point.curvature * left)
            found = max(way - REACH_M, min(way + REACH_M, found + ahead / stretch))
        return found

    def beside(self, pose: Pose2d, way: float) -> tuple[float, float, CoursePoint]:
        """The distance of a pose ahead of a place, to its left, and the place."""
        point = self.at(way)
        dx, dy = pose.x - point.x, pose.y - point.y
        cosine, sine = math.cos(point.direction), math.sin(point.direction)
        return cosine * dx + sine * dy, cosine * dy - sine * dx, point

    def bends(self) -> list[tuple[float, float, float]]:
        """Begin, end and curvature of each piece."""
        return [
            (start, start + piece.length, piece.start.curvature)
            for start, piece in zip(self._starts, self._pieces, strict=True)
        ]


def distinct(points: Sequence[Point]) -> list[Point]:
    """The points without repetitions of the one before."""
    kept: list[Point] = []
    for point in points:
        if not kept or math.dist(kept[-1], point) > SAME_POINT_M:
            kept.append(point)
    return kept


def rounded(points: Sequence[Point], corner_m: float, tightest_m: float) -> list[Course]:
    """Make the courses between the corners at which the base has to stop.

    An arc that touches both sides of a corner at the distance t has the radius ``t / tan(a/2)`` for
    a change of direction by a, and passes the corner at ``r (1 / cos(a/2) - 1)``.

    Args:
        points: Two at least, distinct.
        corner_m: How far an arc may pass a corner.
        tightest_m: The smallest radius of an arc.
    """
    courses: list[Course] = []
    pieces: list[tuple[float, float]] = []
    direction = _direction(points[0], points[1])
    begin = Pose2d(x=points[0][0], y=points[0][1], theta=direction)
    used = 0.0
    for index in range(1, len(points)):
        length = math.dist(points[index - 1], points[index])
        if index == len(points) - 1:
            pieces.append((length - used, 0.0))
            break
        after = math.dist(points[index], points[index + 1])
        turn = wrapped(_direction(points[index], points[index + 1]) - direction)
        half = abs(turn) / 2.0
        reach, radius = 0.0, math.inf
        if 1e-9 < half < math.pi / 2.0 - 1e-3:
            cut = 1.0 / math.cos(half) - 1.0
            radius = min(corner_m / cut, min(length, after) / 2.0 / math.tan(half))
            reach = radius * math.tan(half)
        direction += turn
        if half >= math.pi / 2.0 - 1e-3 or radius < tightest_m:
            pieces.append((length - used, 0.0))
            courses.append(Course(begin, pieces))
            pieces, used = [], 0.0
            begin = Pose2d(x=points[index][0], y=points[index][1], theta=direction)
            continue
        pieces.append((length - used - reach, 0.0))
        if reach:
            pieces.append((abs(turn) * radius, math.copysign(1.0 / radius, turn)))
        used = reach
    courses.append(Course(begin, pieces))
    return courses


def _direction(one: Point, other: Point) -> float:
    return math.atan2(other[1] - one[1], other[0] - one[0])


def car_path(begin: Pose2d, goal: Pose2d, radius_m: float) -> Pieces:
    """Length and curvature of each piece of the shortest way of a car: arcs, and a straight.

    The six words of Dubins (*On curves of minimal length*, 1957), by the closed forms of Shkel and
    Lumelsky (*Classification of the Dubins set*, 2001).
    """
    dx, dy = goal.x - begin.x, goal.y - begin.y
    distance = math.hypot(dx, dy) / radius_m
    bearing = math.atan2(dy, dx) if distance else 0.0
    alpha = _positive(begin.theta - bearing)
    beta = _positive(goal.theta - bearing)
    best: tuple[float, str, tuple[float, float, float]] | None = None
    for word, lengths in _words(distance, alpha, beta):
        total = sum(lengths)
        if best is None or total < best[0]:
            best = total, word, lengths
    assert best is not None
    curvature = {"L": 1.0 / radius_m, "S": 0.0, "R": -1.0 / radius_m}
    return [
        (length * radius_m, curvature[letter])
        for letter, length in zip(best[1], best[2], strict=True)
        if length * radius_m > 1e-6
    ]


def car_path_to_point(begin: Pose2d, x: float, y: float, radius_m: float) -> Pieces:
    """The shortest way to a point, with any heading there."""
    ways = (
        car_path(begin, Pose2d(x=x, y=y, theta=2.0 * math.pi * index / HEADINGS), radius_m)
        for index in range(HEADINGS)
    )
    return min(ways, key=lambda way: sum(length for length, _ in way))


def _words(d: float, alpha: float, beta: float) -> list[tuple[str, tuple[float, float, float]]]:
    sa, sb, ca, cb = math.sin(alpha), math.sin(beta), math.cos(alpha), math.cos(beta)
    difference = math.cos(alpha - beta)
    found: list[tuple[str, tuple[float, float, float]]] = []

    square = 2.0 + d * d - 2.0 * difference + 2.0 * d * (sa - sb)
    if square >= 0.0:
        angle = math.atan2(cb - ca, d + sa - sb)
        found.append(
            ("LSL", (_positive(angle - alpha), math.sqrt(square), _positive(beta - angle)))
        )
    square = 2.0 + d * d - 2.0 * difference + 2.0 * d * (sb - sa)
    if square >= 0.0:
        angle = math.atan2(ca - cb, d - sa + sb)
        found.append(
            ("RSR", (_positive(alpha - angle), math.sqrt(square), _positive(angle - beta)))
        )
    square = -2.0 + d * d + 2.0 * difference + 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        angle = math.atan2(-ca - cb, d + sa + sb) - math.atan2(-2.0, p)
        found.append(("LSR", (_positive(angle - alpha), p, _positive(angle - beta))))
    square = -2.0 + d * d + 2.0 * difference - 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        angle = math.atan2(ca + cb, d - sa - sb) - math.atan2(2.0, p)
        found.append(("RSL", (_positive(alpha - angle), p, _positive(beta - angle))))
    cosine = (6.0 - d * d + 2.0 * difference + 2.0 * d * (sa - sb)) / 8.0
    if abs(cosine) <= 1.0:
        p = _positive(2.0 * math.pi - math.acos(cosine))
        t = _positive(alpha - math.atan2(ca - cb, d - sa + sb) + p / 2.0)
        found.append(("RLR", (t, p, _positive(alpha - beta - t + p))))
    cosine = (6.0 - d * d + 2.0 * difference + 2.0 * d * (sb - sa)) / 8.0
    if abs(cosine) <= 1.0:
        p = _positive(2.0 * math.pi - math.acos(cosine))
        t = _positive(-alpha - math.atan2(ca - cb, d + sa - sb) + p / 2.0)
        found.append(("LRL", (t, p, _positive(beta - alpha - t + p))))
    return found


def _positive(angle: float) -> float:
    turned = angle % (2.0 * math.pi)
    # Rounding may give 2 pi instead of 0.
    return 0.0 if 2.0 * math.pi - turned < 1e-9 else turned


def wrapped(angle: float) -> float:
    """The angle in -pi to pi."""
    return math.remainder(angle, 2.0 * math.pi)
