"""Polylines: corners become arcs, or stops."""

from __future__ import annotations

import math

import pytest

from yahboomd.moves.motion.move_course import distinct, rounded

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def farthest(courses: list, corner: tuple[float, float]) -> float:
    """How far the courses pass a corner."""
    places = [(c.at(way / 1000.0)) for c in courses for way in range(int(1000 * c.length))]
    return min(math.hypot(p.x - corner[0], p.y - corner[1]) for p in places)


def test_a_corner_is_cut_by_as_much_as_allowed() -> None:
    (course,) = rounded(SQUARE, 0.06, 0.05)
    assert farthest([course], (1.0, 0.0)) == pytest.approx(0.06, abs=1e-3)
    assert (course.end.x, course.end.y) == pytest.approx((0.0, 1.0))
    radii = [1.0 / abs(k) for _, _, k in course.bends() if k]
    assert radii == pytest.approx([0.06 / (math.sqrt(2.0) - 1.0)] * 2)


def test_a_corner_that_would_be_too_tight_is_a_stop() -> None:
    courses = rounded(SQUARE, 0.01, 0.05)
    assert [course.length for course in courses] == pytest.approx([1.0, 1.0, 1.0])


def test_a_way_back_is_a_stop() -> None:
    courses = rounded([(0.0, 0.0), (1.0, 0.0), (0.0, 0.0)], 0.1, 0.05)
    assert len(courses) == 2


def test_a_smooth_polyline_becomes_one_course_with_its_curvature() -> None:
    circle = [
        (math.sin(0.02 * i / 0.5) * 0.5, 0.5 - 0.5 * math.cos(0.02 * i / 0.5)) for i in range(60)
    ]
    (course,) = rounded(circle, 0.01, 0.05)
    bends = [k for begin, end, k in course.bends() if k]
    assert min(bends) == pytest.approx(2.0, rel=0.01)
    assert course.length == pytest.approx(59 * 0.02, rel=1e-3)


def test_points_that_repeat_are_one() -> None:
    assert distinct([(0.0, 0.0), (0.0, 1e-6), (1.0, 0.0)]) == [(0.0, 0.0), (1.0, 0.0)]
