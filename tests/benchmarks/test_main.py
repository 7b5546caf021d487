"""Every point of the benchmarks runs, and what it found is on the page."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.realtime


def bench(where: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [
            sys.executable,
            "-m",
            "benchmarks",
            "--out",
            where,
            "--store",
            where / "store",
            *arguments,
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.timeout(240)
@pytest.mark.parametrize(
    ("name", "words", "images"),
    [
        ("exactness", "random paths", {"convergence.png", "random_paths.png"}),
        ("baseline", "the article's bridge", set()),
        ("latency", "bare Zenoh callback", set()),
        ("throughput", "Polls a second", set()),
        ("cost", "By room", {"flame.svg"}),
        ("fleet", "One router", set()),
    ],
)
def test_a_short_run_of_each_point_writes_its_tables_and_pictures(
    tmp_path: Path, name: str, words: str, images: set[str]
) -> None:
    run = bench(tmp_path, "--short", name)
    assert run.returncode == 0, run.stderr
    page = (tmp_path / "benchmarks.md").read_text()
    assert words in page
    assert "| --- |" in page
    assert "A short run" in page
    assert {file.name for file in (tmp_path / "images").iterdir()} == images
    assert all(f"images/{image}" in page for image in images)


def test_a_name_that_is_no_point_is_refused(tmp_path: Path) -> None:
    run = bench(tmp_path, "speed")
    assert run.returncode == 2
    assert "there is no speed" in run.stderr
