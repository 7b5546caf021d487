"""Polylines to courses: corners become arcs, or stops if the arcs would be too tight."""

from __future__ import annotations

import math
from collections.abc import Sequence

from yahboomd.core.model import Pose2d
from yahboomd.moves.motion.move_course import Course, wrapped

TIGHTEST_M = 0.05
"""An arc with a smaller radius is a corner at which a base stops."""

SAME_POINT_M = 1e-4

Point = tuple[float, float]


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
