"""The comparison of moves with a plain loop, in short."""

from __future__ import annotations

import math

import pytest

from benchmarks.move_table import one, table

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
