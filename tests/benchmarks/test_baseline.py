from __future__ import annotations

import pytest

from benchmarks.baseline import P50, POLLS, factor
from benchmarks.drivers import frames
from yahboomd.simulation.heard import HostBytes


def test_of_polls_more_is_better_and_of_everything_else_less() -> None:
    assert factor(POLLS, "20.0", "50.0") == "2.50"
    assert factor(P50, "50.0", "0.500") == "100"
    assert factor(P50, "0.500", "50.0") == "0.0100"


@pytest.mark.parametrize(
    ("article", "ours"),
    [("never", "0.5"), ("1.0", "-"), ("25.0", "0"), ("-204", "1.0"), ("no", "yes")],
)
def test_where_a_figure_is_none_or_zero_there_is_no_ratio(article: str, ours: str) -> None:
    assert factor(P50, article, ours) == "-"


def test_speed_frames_are_found_behind_one_another_and_since_a_moment() -> None:
    heard = [
        HostBytes(t_ns=1, data="$speed:1,0,2,0#"),
        HostBytes(t_ns=2, data="$read#$speed:-3,0,4,0#$speed:5,0,-6,0#"),
    ]
    assert frames(heard, 2) == [(2, -3, 4), (2, 5, -6)]
