"""Python 3.10, of Ubuntu 22.04 and ROS 2 Humble: the client works, commands say what they need."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from client_programs import EXAMPLES, ROOT, Missing, oldest_python
from real_robot import RealRobot, free_endpoint

pytestmark = pytest.mark.realtime

WAITS = """
import asyncio, sys
from yahboomd.client import EventSample, NoDaemon, PoseSample, Robot, connect

there, nowhere = sys.argv[1:]
with Robot(there) as robot:
    assert robot.status.state == "standing"
    assert len(list(zip(range(3), robot.samples(PoseSample)))) == 3
    assert robot.standing(within_s=20.0)
    # Nothing happens, so no event comes, and the loop ends.
    assert list(robot.samples(EventSample, timeout_s=0.2)) == []

async def main():
    async with connect(there) as robot:
        async for pose in robot.samples(PoseSample):
            break
        # One that waits in vain is told so, by the built-in error that 3.11 has.
        try:
            async with connect(nowhere, wait_s=0.2):
                pass
        except NoDaemon as error:
            print(error)

asyncio.run(main())
"""


@pytest.fixture(scope="module")
def python() -> Path:
    try:
        return oldest_python()
    except Missing as missing:
        pytest.skip(str(missing))


def run(python: Path, *arguments: str, **environ: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(python), *arguments],
        env={**os.environ, "PYTHONPATH": str(ROOT), **environ},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_a_program_drives_waits_and_is_told(
    python: Path, real_robot: Callable[..., RealRobot]
) -> None:
    robot = real_robot()
    robot.daemon.says("Connected")
    done = run(python, "-c", WAITS, robot.endpoint, free_endpoint())
    assert done.returncode == 0, done.stderr
    assert "No yahboomd answers" in done.stdout
    short = run(python, str(EXAMPLES / "python_client" / "arc.py"), ROBOT=robot.endpoint)
    assert short.returncode == 0, short.stderr
    assert robot.travelled_m() > 0.1


@pytest.mark.nightly
def test_every_module_of_the_client_can_be_imported(python: Path) -> None:
    modules = [
        f"yahboomd.client.{each.stem}" for each in (ROOT / "yahboomd/client").glob("[a-z]*.py")
    ]
    done = run(python, "-c", f"import {', '.join(modules)}")
    assert done.returncode == 0, done.stderr


@pytest.mark.nightly
@pytest.mark.parametrize("words", ["status", "run --port /dev/null", "--help"])
def test_a_command_says_in_one_line_what_it_needs(python: Path, words: str) -> None:
    done = run(python, "-m", "yahboomd", *words.split())
    assert done.returncode == os.EX_CONFIG
    assert done.stderr.count("\n") == 1
    assert "its commands need 3.11 or later" in done.stderr
    assert "uv tool install" in done.stderr
