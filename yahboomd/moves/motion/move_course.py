"""Courses: lines and arcs in a row, with the place along them that is nearest to a pose."""

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


def wrapped(angle: float) -> float:
    """The angle in -pi to pi."""
    return math.remainder(angle, 2.0 * math.pi)
