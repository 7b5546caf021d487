"""The soak, for less than a minute: ``make soak MINUTES=60`` is the same for longer."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks.soak import Ledger, Soak

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.realtime
@pytest.mark.nightly
def test_through_faults_it_stops_comes_back_and_knows_where_it_is() -> None:
    kinds = "SIGKILL,unplug,byte loss"
    arguments = ("--minutes", "0.3", "--dialects", "streamed", "--kinds", kinds)
    run = subprocess.run(
        [sys.executable, "-m", "benchmarks.soak", *arguments],
        cwd=ROOT,
        check=False,
        env={**os.environ, "PYTHONPATH": "tests/plugins"},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    assert "verdict: all held" in run.stdout
    assert "Pose against the truth" in run.stdout


@pytest.mark.parametrize(("stalled_s", "failures"), [(0.0, 1), (0.2, 0)])
def test_a_late_stop_is_a_failure_unless_the_machine_stood_still(stalled_s, failures) -> None:
    soak: Any = Soak.__new__(Soak)
    soak.ledger, soak.dialect, soak.kind, soak._since_ns = Ledger(), "streamed", "e-stop", 0
    soak.truth = SimpleNamespace(stood_at=lambda since_ns: since_ns + 2_000_000_000)
    soak.stalls = SimpleNamespace(since_s=lambda _since_ns: stalled_s)
    soak.app = SimpleNamespace(status=(0.0, {}))
    soak.stands(0, 2.1)
    assert soak.ledger.failures == soak.ledger.excused == []
    soak.stands(0, 0.8)
    assert (len(soak.ledger.failures), len(soak.ledger.excused)) == (failures, 1 - failures)
    assert ("FAILED" in soak.ledger.table()) is bool(failures)
