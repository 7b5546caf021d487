"""Power is cut at any write: each reader finds the old file or the new one, and a whole one."""

from __future__ import annotations

import json
import os
import random
import shutil
from pathlib import Path
from typing import Any

import pytest
from cut_disk import Change, Step, after_a_cut, changes_below, record, whole
from kept_files import KEPT, Kept

CUTS = int(os.environ.get("YAHBOOMD_POWER_CUTS", "25"))
"""Of each kind; `make power-cuts` makes 1,000."""

PROGRAM = Path(__file__).parents[1] / "plugins/kept_files.py"

pytestmark = [
    pytest.mark.xdist_group("power_cuts"),
    pytest.mark.realtime,
    pytest.mark.skipif(shutil.which("strace") is None, reason="no strace on this machine"),
]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """Everything that is kept, and the calls that wrote it."""
    root = tmp_path_factory.mktemp("written") / "disk"
    try:
        return root, record(PROGRAM, root)
    except PermissionError:
        pytest.skip("this machine lets no process be traced")


def found_after_cuts(
    kept: Kept, changes: list[Change], values: list[Any], folder: Path, cuts: int
) -> list[str]:
    """The cuts after which a reader has something else than it may have, in words."""
    wrong = []
    for number in range(cuts):
        chance = random.Random(number)
        at = chance.randint(0, len(changes))
        done = sum(isinstance(change, Step) for change in changes[:at])
        disk = folder / str(number)
        disk.mkdir(mode=0o700)
        for path, content in after_a_cut(changes[:at], chance).items():
            left = disk / path.rpartition("/")[2]
            left.write_bytes(content)
            left.chmod(0o600)
        try:
            found = kept.read(disk)
        except Exception as error:
            wrong.append(f"cut {number}: {error!r}")
            continue
        finally:
            shutil.rmtree(disk)
        before, after = values[done], values[min(done + 1, len(values) - 1)]
        if not kept.fits(found, before, after):
            wrong.append(f"cut {number}: {found}, and it was {before}, then {after}")
    return wrong


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", KEPT)
def test_after_a_power_cut_the_old_file_is_there_or_the_new_one(
    written: tuple[Path, list[str]], tmp_path: Path, name: str
) -> None:
    root, calls = written
    folder = root / str(list(KEPT).index(name))
    changes = changes_below(folder, calls)
    # The record lacks no call: without a cut it makes the files that are there.
    assert whole(changes) == {
        str(path): path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()
    }
    values = json.loads((root.parent / "values.json").read_text())[name]
    assert len(values) == 1 + len(KEPT[name].steps)
    assert found_after_cuts(KEPT[name], changes, values, tmp_path, CUTS) == []


CARELESS = """
import os, sys
folder = sys.argv[1]
os.makedirs(folder)
for text in (b"one", b"two"):
    with open(f"{folder}/new", "wb") as file:
        file.write(text)
    os.rename(f"{folder}/new", f"{folder}/kept")
    try:
        os.open(f"/yahboomd-step-{os.path.basename(folder)}", 0)
    except OSError:
        pass
"""


def test_a_name_that_is_on_the_disk_before_the_content_is_found(tmp_path: Path) -> None:
    program, folder = tmp_path / "careless.py", tmp_path / "0"
    program.write_text(CARELESS)
    changes = changes_below(folder, record(program, folder))

    def read(disk: Path) -> str:
        path = disk / "kept"
        return path.read_text() if path.exists() else ""

    (tmp_path / "cuts").mkdir()
    wrong = found_after_cuts(Kept((), read), changes, ["", "one", "two"], tmp_path / "cuts", 200)
    # Empty or half, or an older one though the step was done.
    assert any("\\x00" in words or ": ," in words or "t," in words for words in wrong)
    assert len(wrong) > 20
