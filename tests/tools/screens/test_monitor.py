from __future__ import annotations

import asyncio
import sys
from typing import Any

import daemon_samples
import pytest
from zenoh_fixtures import free_endpoint

from yahboomd.cli.main import main

pytestmark = pytest.mark.realtime


async def printed(*arguments: str) -> tuple[int, str, str]:
    """Run the monitor without a terminal."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-W", "error", "-m", "yahboomd", "monitor", *arguments),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    out, err = await process.communicate()
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


async def test_one_look_prints_everything_and_ends(fake_daemon: Any) -> None:
    daemon = await fake_daemon(namespace="bot1")
    robot = ("--connect", daemon.endpoint, "--namespace", "bot1")
    status, out, err = await printed("--once", "--timeout", "60", *robot)
    assert (status, err) == (0, "")
    rows = dict(line.split(maxsplit=1) for line in out.splitlines())
    assert rows["daemon"] == f"bot1 at {daemon.endpoint}"
    assert rows["why"] == "At rest."
    assert rows["pose"].startswith("x 1.500 m")


@pytest.mark.parametrize("seconds", ["-1", "nan", "inf", "soon"])
def test_a_timeout_must_be_a_number_of_seconds(
    capsys: pytest.CaptureFixture[str], seconds: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["monitor", "--once", f"--timeout={seconds}"])
    assert ended.value.code == 2
    assert f"--timeout: {seconds} is not a number of seconds" in capsys.readouterr().err


async def test_on_a_terminal_it_follows_the_daemon_and_leaves_no_trace(
    terminal: Any, fake_daemon: Any
) -> None:
    endpoint = free_endpoint()
    process = terminal("monitor", "--connect", endpoint, columns=120, lines=30)
    await process.shows(f"waiting for a daemon at {endpoint}")
    daemon = await fake_daemon(endpoint=endpoint)
    await process.shows("● STANDING")
    await process.shows("path, x is up")
    daemon.status = daemon_samples.status("estopped", why="Emergency stop, by hand.")
    await process.shows("Emergency stop, by hand.")
    await daemon.stop()
    await process.shows("NO STATUS")
    await daemon.start()
    await process.shows("● ESTOPPED")
    process.type("q")
    assert await process.ended() == 0
    assert process.restored
