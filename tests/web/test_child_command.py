"""Children end with the server, in order if they can, by force if they do not."""

from __future__ import annotations

import asyncio
import contextlib
import os
import select
import signal
from pathlib import Path

import pytest
from real_robot import PATIENCE_S
from zenoh_fixtures import eventually

from yahboomd.web import child_command
from yahboomd.web.child_command import Child, output_of

pytestmark = pytest.mark.realtime


async def test_a_command_runs_to_its_end_without_a_shell() -> None:
    status, printed, last_words = await output_of(["--version"])
    assert (status, last_words) == (0, "")
    assert printed.startswith("yahboomd ")
    status, printed, last_words = await output_of(["config", "show; echo no", "$(id)"])
    assert status == 2
    assert "uid=" not in printed + last_words
    # What it complains of is kept, without the program's name.
    status, _, last_words = await output_of(["config", "check", "--config=/none"])
    assert status == 78
    assert last_words.startswith("The configuration has a mistake:\n/none")


async def test_a_command_that_takes_too_long_is_ended_and_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(child_command, "END_S", 0.2)
    status, printed, last_words = await output_of(["simulate"], within_s=2.0)
    assert (status, printed) == (os.EX_TEMPFAIL, "")
    assert last_words == "It took longer than 2 s, and was ended."


async def test_a_child_that_does_not_end_is_killed_with_its_group(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(child_command, "END_S", 0.2)
    program, noted = tmp_path / "program", tmp_path / "pid"
    program.write_text(
        f"#!/bin/sh\ntrap '' TERM INT\nsleep 600 &\necho $! >{noted}.new\n"
        f"mv {noted}.new {noted}\nwait\n"
    )
    program.chmod(0o755)
    monkeypatch.setattr("sys.executable", str(program))
    child = await Child.start(["events"])
    assert os.getpgid(child._process.pid) == child._process.pid
    await eventually(noted.exists)
    its_own = os.pidfd_open(int(noted.read_text()))
    try:
        async with asyncio.timeout(PATIENCE_S):
            assert await child.end() == -signal.SIGKILL
        # A descriptor of a process can be read once it has ended.
        assert select.select([its_own], [], [], PATIENCE_S)[0]
    finally:
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(its_own, signal.SIGKILL)
        os.close(its_own)
