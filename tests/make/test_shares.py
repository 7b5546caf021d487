"""Of a test with many cases a run takes a share, in which each value of a parameter is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import shares

pytestmark = pytest.mark.realtime

TESTS = """
import pytest

@pytest.mark.share(4)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("board", ["one", "two", "three"])
@pytest.mark.parametrize("for_s", [0.1, 0.2])
def test_grid(for_s, board, seed): pass

@pytest.mark.share(4)
@pytest.mark.parametrize("cause", range(6))
def test_causes(cause): pass

@pytest.mark.parametrize("case", range(7))
def test_others(case): pass
"""


def passed(folder: Path, *arguments: str, **environment: str) -> list[str]:
    """The tests that passed, as the verbose report names them."""
    (folder / "conftest.py").write_text("from shares import pytest_collection_modifyitems\n")
    (folder / "pytest.ini").write_text("[pytest]\nmarkers = share(n)")
    (folder / "test_it.py").write_text(TESTS)
    given = {name: value for name, value in os.environ.items() if name != "YAHBOOMD_GRIDS"}
    found = subprocess.run(
        [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider", *arguments],
        cwd=folder,
        env={**given, "PYTHONPATH": str(Path(shares.__file__).parent), **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    lines = found.stdout.splitlines()
    return [line.split()[0].partition("::")[2] for line in lines if " PASSED " in line]


def test_a_run_takes_a_share_with_each_value_and_all_cases_if_asked(tmp_path: Path) -> None:
    taken = passed(tmp_path)
    grid = [name for name in taken if name.startswith("test_grid")]
    assert len(grid) == 8  # of 30, rounded up
    for value in ("one", "two", "three", "[0.1", "[0.2"):
        assert any(value in name for name in grid), value
    # A value without another case is not left out, and unmarked tests are whole.
    assert len([name for name in taken if name.startswith("test_causes")]) == 6
    assert len([name for name in taken if name.startswith("test_others")]) == 7
    assert taken == passed(tmp_path), "the same ones every time"
    assert len(passed(tmp_path, YAHBOOMD_GRIDS="1")) == 30 + 6 + 7
    assert len(passed(tmp_path, "-k", "test_grid")) == 30
    assert len(passed(tmp_path, "test_it.py::test_grid")) == 30
