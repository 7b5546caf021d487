"""The comparison of moves with a plain loop, in short."""

from __future__ import annotations

import math

import pytest

from benchmarks.move_table import one, square, table
from yahboomd.simulation.virtual_time import run

EACH = 4


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Half as many moves of each robot."""
    monkeypatch.setattr("benchmarks.move_table.EACH", EACH)


@pytest.mark.parametrize("lag_s", [0.06, 0.25])
def test_straights_end_nearer_than_those_of_a_plain_loop(lag_s: float) -> None:
    ours = one(("2wd", lag_s, "straight", 7, False))
    plain = one(("2wd", lag_s, "straight", 7, True))
    assert len(ours) == len(plain) == EACH
    assert all(each.reached and each.place_m < 0.002 for each in ours)
    assert max(each.place_m for each in plain) > 0.003


def test_paths_are_followed_within_a_centimetre() -> None:
    ours = one(("4wd", 0.15, "follow", 3, False))
    assert max(each.beside_m for each in ours) < 0.01


def test_the_table_has_the_percentiles_of_both() -> None:
    results = one(("2wd", 0.1, "turn", 1, False))
    assert max(each.heading_rad for each in results) < math.radians(0.6)
    rows = table(results * 2, results)
    assert f"{2 * EACH} of {2 * EACH} moves" in rows


def test_squares_whose_poses_come_late_take_longer_and_say_why_if_they_end_short() -> None:
    soon, late = run(square("2wd", 0.1, 0.0)), run(square("2wd", 0.1, 0.1))
    assert {each.ended.reason for each in soon} == {"reached"}
    over = [sum(each.time_s - each.ideal_s for each in drives) for drives in (late, soon)]
    assert over[0] > 1.5 * over[1]
    short = [each.ended.message for each in late if each.ended.reason == "short"]
    assert short
    assert all("Poses came up to 0." in each for each in short)
