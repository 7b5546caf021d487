from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.tools.screens.path_map import path_map

COORDINATE = st.floats(-1e4, 1e4)


@given(
    st.lists(st.tuples(COORDINATE, COORDINATE), min_size=1, max_size=20),
    st.floats(-100, 100),
    st.integers(1, 60),
    st.integers(1, 30),
)
def test_a_map_has_the_size_that_was_asked_for_with_the_robot_on_it(
    trail: list[tuple[float, float]], theta: float, width: int, height: int
) -> None:
    lines, (column, row), scale_m = path_map(trail, theta=theta, width=width, height=height)
    assert len(lines) == height
    assert all(len(line) == width for line in lines)
    assert lines[row][column] in "↑↖←↙↓↘→↗"
    assert scale_m > 0.0


@pytest.mark.parametrize(
    ("theta", "arrow"),
    [(0.0, "↑"), (math.pi / 2, "←"), (-math.pi / 2, "→"), (math.pi, "↓"), (math.pi / 4, "↖")],
)
def test_the_arrow_points_where_the_robot_looks(theta: float, arrow: str) -> None:
    lines, (column, row), _ = path_map([(0.0, 0.0)], theta=theta, width=9, height=5)
    assert lines[row][column] == arrow


def test_forward_is_up_and_left_is_left() -> None:
    _, start, _ = path_map([(1.0, 1.0), (0.0, 0.0)], theta=0.0, width=20, height=10)
    _, end, _ = path_map([(0.0, 0.0), (1.0, 1.0)], theta=0.0, width=20, height=10)
    assert end[0] < start[0]
    assert end[1] < start[1]
