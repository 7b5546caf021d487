from __future__ import annotations

from benchmarks.throughput import deviations

MS = 1_000_000


def test_a_perfect_grid_deviates_by_nothing() -> None:
    assert set(deviations([7 + n * 20 * MS for n in range(10)], 20 * MS)) == {0}


def test_one_late_beat_and_one_missed_beat_show_as_what_they_are() -> None:
    stamps = [n * 20 * MS for n in range(10) if n != 4]
    stamps[6] += 3 * MS
    assert sorted(deviations(stamps, 20 * MS)) == [0] * 8 + [3 * MS]
