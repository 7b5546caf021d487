"""Tests in real time need a machine that runs: one that stood still is no finding about them.

Other programs make such tests slow, and they allow for that. But a virtual computer may be stopped
for seconds, and so may a kernel's thread that passes on the bytes of pseudo-terminals; then a
simulated board is silent and deaf as no real one is. A process beside the tests notes when that
happened. A test that failed meanwhile is run once more, and the end of the run names it.
"""

from __future__ import annotations

import atexit
import functools
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

from _pytest.runner import runtestprotocol

if TYPE_CHECKING:
    import pytest

STOOD_S = 0.25
"""A busy machine alone keeps a process waiting for less."""

RAN_AGAIN = "ran again"

WATCH = """
import os, pty, sys, time, tty
ours, theirs = pty.openpty()
tty.setraw(theirs)
print("watching", flush=True)
while os.getppid() == int(sys.argv[1]):
    began = time.monotonic()
    time.sleep(0.02)
    for into, out in (ours, theirs), (theirs, ours):
        os.write(into, b"x")
        os.read(out, 1)
    ended = time.monotonic()
    if ended - began > float(sys.argv[2]):
        print(began, ended, flush=True)
"""
"""Sends a byte each way through a pseudo-terminal, and says from when to when that took long."""


@functools.cache
def watch(folder: Path) -> tuple[Path, subprocess.Popen[bytes]]:
    """Start to watch, once; returns the file of what the process has seen, and the process."""
    said = folder / "standstill"
    with said.open("wb") as out:
        command = [sys.executable, "-c", WATCH, str(os.getpid()), str(STOOD_S)]
        process = subprocess.Popen(command, stdout=out)
    atexit.register(process.wait)
    atexit.register(process.kill)
    while process.poll() is None and not said.stat().st_size:
        time.sleep(0.01)
    return said, process


def stood_s(said: Path, since_s: float) -> float:
    """For how long the machine stood still at most, since a moment of the monotonic clock."""
    time.sleep(2 * STOOD_S)  # what ended just now is noted
    pauses = [line.split() for line in said.read_text().splitlines()[1:]]
    return max((float(b) - float(a) for a, b in pauses if float(b) >= since_s), default=0.0)


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Run a test in real time; once more if it failed while the machine stood still."""
    if item.get_closest_marker("realtime") is None:
        return None
    factory: pytest.TempPathFactory = item.config._tmp_path_factory  # type: ignore[attr-defined]
    (said, _), began_s = watch(factory.getbasetemp()), time.monotonic()
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    reports = runtestprotocol(item, nextitem=nextitem, log=False)
    failed = next((each for each in reports if each.failed), None)
    if failed is not None and (pause_s := stood_s(said, began_s)):
        why = failed.longreprtext.splitlines()[-3:]
        item._initrequest()  # type: ignore[attr-defined] - as pytest-rerunfailures does
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        words = [f"{item.nodeid}: the machine stood still for {pause_s:.1f} s", *why]
        reports[0].user_properties.append((RAN_AGAIN, "\n  ".join(words)))
    for each in reports:
        item.ihook.pytest_runtest_logreport(report=each)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the tests that were run again, and how they had failed."""
    reports = (each for found in terminalreporter.stats.values() for each in found)
    facts = (fact for each in reports for fact in getattr(each, "user_properties", ()))
    if ran_again := sorted({words for key, words in facts if key == RAN_AGAIN}):
        terminalreporter.section(f"ran again: {len(ran_again)}")
        for words in ran_again:
            terminalreporter.line(words)
