"""Every benchmark runs and writes its results and tables."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import results

ROOT = Path(__file__).resolve().parents[2]

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]


def start(where: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [
            # Its figures are not asked for: the robots of other tests go first.
            *("nice", "-n", "10", sys.executable, "-m", "benchmarks"),
            *("--out", where, "--store", where / "store", *arguments),
        ],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def bench(where: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    process = start(where, *arguments)
    output, errors = process.communicate()
    return subprocess.CompletedProcess(process.args, process.returncode, output, errors)


BENCHMARKS = {
    "exactness": ("random paths", {"convergence.png", "random_paths.png"}),
    "baseline": ("the article's bridge", set()),
    "latency": ("bare Zenoh callback", {"latency.png"}),
    "cost": ("Beside bare programs", set()),
}


def test_a_short_run_of_a_benchmark_writes_its_results_tables_and_pictures(
    tmp_path: Path,
) -> None:
    # They wait for most of their time, and short ones may disturb each other.
    with contextlib.ExitStack() as stack:
        runs = {name: start(tmp_path / name, "--short", name) for name in BENCHMARKS}
        for run in runs.values():
            stack.callback(run.kill)
        ends = {name: run.communicate() for name, run in runs.items()}
    for name in BENCHMARKS:
        words, images = BENCHMARKS[name]
        assert runs[name].returncode == 0, ends[name][1]
        page = (tmp_path / name / "benchmarks.md").read_text()
        tables = (tmp_path / name / "benchmarks" / f"{name}.md").read_text()
        assert words in tables
        assert "| --- |" in tables
        assert "A short run" in page
        assert f"benchmarks/{name}.md" in page
        assert {file.name for file in (tmp_path / name / "images").iterdir()} == images
        assert all(f"images/{image}" in page for image in images)


def test_an_unknown_benchmark_is_refused(tmp_path: Path) -> None:
    run = bench(tmp_path, "speed")
    assert run.returncode == 2
    assert "there is no speed" in run.stderr


def keep(where: Path) -> Path:
    """Store a benchmark as measured just now."""
    section = results.Section(name="latency", title="Measured", about="Before.", how="Somehow.")
    results.store(section, where / "store")
    return where / "store" / "latency.json"


def test_a_resumed_run_skips_what_was_measured_just_now(tmp_path: Path) -> None:
    file = keep(tmp_path)
    kept = file.read_bytes()
    run = bench(tmp_path, "--short", "--resume", "latency")
    assert run.returncode == 0
    assert run.stdout == ""
    assert file.read_bytes() == kept
    assert "## Measured" in (tmp_path / "benchmarks.md").read_text()


def test_a_benchmark_that_fails_is_named_and_the_others_are_on_the_page(tmp_path: Path) -> None:
    keep(tmp_path)
    (tmp_path / "images" / "convergence.png").mkdir(parents=True)  # in place of its picture
    run = bench(tmp_path, "--short", "--resume", "exactness", "latency")
    assert run.returncode == 1
    assert "Not measured: exactness." in run.stderr
    assert "## Measured" in (tmp_path / "benchmarks.md").read_text()
