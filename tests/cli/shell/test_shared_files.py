"""The files below ``share``: in the source, in the wheel, in the package, on the system."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SHARE = Path(__file__).resolve().parents[3] / "share"


def texts(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_it_writes_every_file_and_removes_what_is_no_more(tmp_path: Path) -> None:
    (tmp_path / "man/man1").mkdir(parents=True)
    (tmp_path / "man/man1/yahboomd-fly.1").touch()
    command = [sys.executable, "-m", "yahboomd.cli.shell.shared_files", str(tmp_path)]
    subprocess.run(command, check=True, timeout=60)
    assert texts(tmp_path) == texts(SHARE)
