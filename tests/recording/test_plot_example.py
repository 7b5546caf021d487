"""The example that draws a recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from pose_recording import record

EXAMPLE = Path(__file__).parents[2] / "examples" / "plot_recording.py"

pytestmark = pytest.mark.realtime


def drawn(folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLE), str(folder)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("ended", [True, pytest.param(False, marks=pytest.mark.nightly)])
def test_a_recording_is_drawn_also_one_that_was_cut_off(tmp_path: Path, ended: bool) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    record(folder, 3000, split=20_000, ended=ended)
    made = drawn(folder)
    assert made.returncode == 0, made.stderr
    assert ("was cut off" in made.stderr) is not ended
    picture = (tmp_path / "run.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 20_000


def test_what_is_no_recording_is_refused_in_words(tmp_path: Path) -> None:
    made = drawn(tmp_path)
    assert made.returncode == 1
    assert "no poses in" in made.stderr
