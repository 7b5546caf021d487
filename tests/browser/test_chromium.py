"""The browser of the tests itself."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from chromium import chromium_program
from real_robot import wait_for

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("browser"), pytest.mark.nightly]

TESTS = """\
import sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from chromium import Chromium
browser = Chromium(Path(sys.argv[1]))
print(browser.process.pid, flush=True)
input()
"""
"""A process of tests that has begun one, and waits to be killed."""


def processes(folder: Path) -> list[int]:
    """The processes of a browser, by the folder of its profile."""
    found = []
    for each in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if os.fsencode(folder) in each.read_bytes():
                found.append(int(each.parent.name))
        except OSError:
            continue
    return found


def test_a_browser_ends_with_the_tests_that_began_it_also_where_they_are_killed(
    tmp_path: Path,
) -> None:
    chromium_program()
    folder = tmp_path / "browser"
    folder.mkdir()
    path = [each for each in sys.path if each]
    with subprocess.Popen(
        [sys.executable, "-c", TESTS, str(folder), *path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as tests:
        assert tests.stdout is not None
        browser = int(tests.stdout.readline())
        assert browser in processes(folder / "profile")
        tests.kill()
    try:
        wait_for(lambda: not processes(folder / "profile"), "every process of the browser ends")
    finally:
        for pid in processes(folder / "profile"):
            os.kill(pid, signal.SIGKILL)
