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


def test_a_path_is_drawn_without_holes() -> None:
    trail = [(0.04 * step, 0.0) for step in range(11)]
    lines, _, _ = path_map(trail, theta=0.0, width=5, height=10)
    assert sum(line != "     " for line in lines) >= 8
    column = next(index for index, each in enumerate(lines[5]) if each != " ")
    inner = [line[column] for line in lines[2:8]]
    assert " " not in inner


def test_a_pose_that_was_set_is_not_joined_to_the_path() -> None:
    joined, _, _ = path_map([(0.0, 0.0), (0.4, 0.0)], theta=0.0, width=5, height=10)
    jumped, _, _ = path_map([(0.0, 0.0), (4.0, 0.0)], theta=0.0, width=5, height=10)
    assert sum(line.strip() != "" for line in joined) > 2
    assert sum(line.strip() != "" for line in jumped) == 2


def test_a_robot_that_stands_does_not_fill_the_map_with_noise() -> None:
    noise = [(0.001 * (step % 3), 0.001 * (step % 2)) for step in range(50)]
    lines, _, _ = path_map(noise, theta=0.0, width=40, height=20)
    assert sum(each != " " for line in lines for each in line) <= 4
