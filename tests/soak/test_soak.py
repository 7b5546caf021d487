"""The soak, for less than a minute: that everything held, not how fast it was.

``make soak MINUTES=60`` is the same for longer, and judges latencies too.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from made_boxes import saved_box

from benchmarks.soak.__main__ import black_boxes
from yahboomd.blackbox.saved_boxes import save_box

pytestmark = pytest.mark.realtime

HERE = Path(__file__).parents[2]


def soak(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [
            *(sys.executable, "-m", "benchmarks.soak"),
            *("--json", str(folder / "figures"), *arguments),
        ],
        cwd=HERE,
        env={**os.environ, "TMPDIR": str(folder), "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def figures(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "figures").read_bytes())
    return found


KINDS = "command silence,SIGKILL,short unplug,e-stop,brown-out,lost answers,byte loss"


@pytest.mark.nightly
def test_through_faults_it_stops_comes_back_and_knows_where_it_is(tmp_path: Path) -> None:
    process = soak(tmp_path, "--minutes", "0.35", "--kinds", KINDS)
    output, _ = process.communicate()
    found = figures(tmp_path)
    assert found["failures"] == [], output
    assert found["jumps"] == 0
    assert found["poses"] > 100
    assert found["stops"] >= 1
    assert found["drives"] >= 1
    assert len(found["faults"]) >= 2
    assert found["tracebacks"] == 0
    assert found["rss_end_mb"] < found["rss_start_mb"] + 30.0
    assert "faults injected" in output


def test_black_boxes_are_counted_and_damaged_ones_named(tmp_path: Path) -> None:
    for data in (saved_box(), saved_box()[:400], b"none"):
        save_box(tmp_path, data, reason="estop", wall_ns=1)
    count, wrong = black_boxes(tmp_path)
    assert count == 3
    assert [words[:7] for words in wrong] == ["000002_", "000003_"]
    assert black_boxes(tmp_path / "nowhere") == (0, [])


@pytest.mark.nightly
def test_ended_early_it_tells_what_it_knows_and_leaves_nothing_running(tmp_path: Path) -> None:
    process = soak(tmp_path, "--minutes", "5", "--kinds", "jitter")
    assert process.stdout is not None
    lines: list[str] = []
    while "jitter" not in "".join(lines):
        lines.append(process.stdout.readline())
        assert process.poll() is None or lines[-1], "".join(lines)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate()
    assert "verdict" in output
    assert figures(tmp_path)["faults"]["jitter"] >= 1
    deadline = time.monotonic() + 60.0
    while (left := processes_that_know(tmp_path)) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert left == []


def processes_that_know(folder: Path) -> list[str]:
    """Command lines in which a folder appears."""
    found = []
    for entry in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = entry.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if str(folder) in line:
            found.append(line)
    return found
