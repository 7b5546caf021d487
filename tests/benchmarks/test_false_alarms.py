"""A short form of ``make alarms``."""

from __future__ import annotations

from benchmarks.false_alarms import Floor, run, table
from yahboomd.simulation.options import SimulationOptions


def test_a_run_drives_for_its_minutes_and_cuts_every_wheel_that_breaks() -> None:
    floor = Floor.of(SimulationOptions())
    tally = run(numbers=range(2), seed=1, lags=(0.05, 0.3), piece_s=15.0, floor=floor)
    assert tally.minutes >= 0.5
    assert sum(map(len, tally.cuts_ms.values())) == 2
    assert not tally.missed
    assert "| minutes driven |" in table(tally)
