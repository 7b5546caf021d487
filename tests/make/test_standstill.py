"""A test that failed while the machine stood still is run once more, and named; no other is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import standstill

pytestmark = pytest.mark.realtime

HOOKS = "from standstill import pytest_runtest_protocol, pytest_terminal_summary\n"
TEST = """
import signal, time
import pytest
import standstill

@pytest.mark.realtime
def test_it(tmp_path_factory):
    with open("runs", "a") as runs:
        print("run", file=runs)
    _, watching = standstill.watch(tmp_path_factory.getbasetemp())
    if STOPS:
        watching.send_signal(signal.SIGSTOP)
        time.sleep(2 * standstill.STOOD_S)
        watching.send_signal(signal.SIGCONT)
    assert len(open("runs").readlines()) >= PASSES_AT, "it failed"
"""


@pytest.mark.parametrize(
    ("stops", "passes_at", "runs", "passes"),
    [(True, 2, 2, True), (True, 9, 2, False), (True, 1, 1, True), (False, 2, 1, False)],
    ids=["passes then", "fails again", "passed at once", "machine ran"],
)
def test_only_a_failure_while_the_machine_stood_still_is_run_again(
    tmp_path: Path, stops: bool, passes_at: int, runs: int, passes: bool
) -> None:
    (tmp_path / "conftest.py").write_text(HOOKS)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = realtime")
    text = TEST.replace("STOPS", str(stops)).replace("PASSES_AT", str(passes_at))
    (tmp_path / "test_it.py").write_text(text)
    found = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(Path(standstill.__file__).parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (tmp_path / "runs").read_text().count("run") == runs
    assert (found.returncode == 0) == passes
    assert ("ran again: 1" in found.stdout) == (runs == 2)
    assert ("test_it: the machine stood still for 0." in found.stdout) == (runs == 2)
