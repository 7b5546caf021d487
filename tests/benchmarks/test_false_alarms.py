"""A short form of ``make alarms``."""

from __future__ import annotations

from benchmarks.false_alarms import Bounds, run, table


def test_a_run_drives_for_its_minutes_and_cuts_every_wheel_that_breaks() -> None:
    bounds = Bounds(
        lags=(0.05, 0.3),
        volts=(8.0, 12.0),
        dialects=("streamed", "streamed", "polled"),
        stick=1.1,
        scales=(0.98, 1.03),
    )
    tally = run(numbers=range(2), seed=1, piece_s=15.0, bounds=bounds)
    assert tally.minutes >= 0.5
    assert sum(map(len, tally.cuts_ms.values())) == 2
    assert not tally.missed
    assert "| minutes driven |" in table(tally)
