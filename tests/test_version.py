"""Each build has a version of its own, and what is written before the build names the release."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from yahboomd import RELEASE

ROOT = Path(__file__).resolve().parents[1]


def version_beside(folder: Path, written: str | None) -> str:
    """What a program sees whose build wrote this."""
    package = folder / "yahboomd"
    package.mkdir()
    shutil.copy(ROOT / "yahboomd" / "__init__.py", package)
    if written is not None:
        (package / "_version.txt").write_text(written)
    code = "import yahboomd; print(yahboomd.__version__)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_a_program_has_the_version_of_its_build(tmp_path: Path) -> None:
    assert version_beside(tmp_path, "0.2.dev7+g0123abc\n") == "0.2.dev7+g0123abc"


def test_a_source_that_was_never_built_says_so(tmp_path: Path) -> None:
    assert version_beside(tmp_path, None) == f"{RELEASE}+source"


@pytest.mark.nightly
def test_a_commit_has_another_version_than_the_tag_and_the_commit_before(tmp_path: Path) -> None:
    def run(*command: str) -> str:
        words = [sys.executable, "-m", "hatchling"] if command[0] == "version" else ["git"]
        who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "tag.gpgsign=false"]
        words += [*who, *command] if words == ["git"] else command
        done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    run("init", "--quiet")
    run("add", ".")
    versions = []
    for tag in (None, "v0.1.0", None):
        run("commit", "--quiet", "--allow-empty", "--message", "a change")
        if tag:
            run("tag", tag)
        versions.append(run("version"))
    assert re.fullmatch(r"0\.1\.dev1\+g[0-9a-f]+", versions[0])
    assert versions[1] == "0.1.0"
    assert re.fullmatch(r"0\.1\.1\.dev1\+g[0-9a-f]+", versions[2])


def test_the_newest_heading_of_the_changelog_is_the_release_that_is_made() -> None:
    heading = re.search(r"^## (\S+?),? ", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert heading is not None
    assert heading[1] == RELEASE
