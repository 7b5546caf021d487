"""Programs that tests install once, into a cache outside the tree."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

CACHE = (
    Path(
        os.environ.get("YAHBOOMD_CACHE")
        or Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache", "yahboomd")
    )
    / "generators"
)


def run(*command: str | Path, cwd: Path | None = None) -> str:
    """The output of a command that has to succeed."""
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def needs(program: str) -> str:
    """The path of a program; without it the test is skipped."""
    found = shutil.which(program)
    if found is None:
        pytest.skip(f"there is no {program} here")
    return found


def installed(name: str, words: str) -> Path | None:
    """The folder of an installation, if it is as described; else None, and an empty folder."""
    folder = CACHE / name
    mark = folder / ".installed"
    if mark.exists() and mark.read_text() == words:
        return folder
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    return None


def npm_packages(name: str, packages: tuple[str, ...]) -> Path:
    """A folder with these packages in ``node_modules``; skipped where npm cannot have them."""
    npm, words = needs("npm"), " ".join(packages)
    if (folder := installed(name, words)) is None:
        folder = CACHE / name
        (folder / "package.json").write_text("{}")
        try:
            run(npm, "install", "--no-audit", "--no-fund", *packages, cwd=folder)
        except AssertionError as error:
            pytest.skip(f"npm could not install {words}: {error}")
        (folder / ".installed").write_text(words)
    return folder
