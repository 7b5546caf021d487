from __future__ import annotations

import asyncio
import signal
import sys
from typing import Any

import daemon_samples
import pytest
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

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


async def test_one_look_where_no_daemon_is_fails_and_says_where_it_looked() -> None:
    endpoint = free_endpoint()
    status, out, err = await printed("--once", "--timeout", "3", "--connect", endpoint)
    assert (status, out) == (69, "")
    assert f"No daemon answered at {endpoint}" in err
    assert "yahboomd run" in err
    assert "Traceback" not in err


@pytest.mark.parametrize("seconds", ["-1", "nan", "inf", "soon"])
def test_a_timeout_must_be_a_number_of_seconds(
    capsys: pytest.CaptureFixture[str], seconds: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["monitor", "--once", f"--timeout={seconds}"])
    assert ended.value.code == 2
    assert f"--timeout: {seconds} is not a number of seconds" in capsys.readouterr().err


async def test_without_a_terminal_it_prints_lines_until_it_is_ended(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-W", "error", "-m", "yahboomd", "monitor"),
        *("--connect", daemon.endpoint),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    assert process.stdout is not None

    async def line_with(words: str) -> str:
        while words not in (line := (await process.stdout.readline()).decode()):
            assert line
        return line

    async with asyncio.timeout(PATIENCE_S):
        # The first lines may come before the first pose.
        assert "standing" in await line_with("x 1.500 m")
        await eventually(lambda: daemon.has_listener)
        daemon.tell("It rains.")
        assert "warning" in await line_with("It rains.")
        await daemon.stop()
        await line_with("no status from the daemon")
        process.send_signal(signal.SIGINT)
        assert await process.wait() == 0
        assert b"Traceback" not in await process.stdout.read()


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


@pytest.mark.parametrize("way", ["\x03", signal.SIGTERM])
async def test_it_ends_cleanly_on_signals_too(terminal: Any, way: str | signal.Signals) -> None:
    process = terminal("monitor", "--connect", free_endpoint())
    await process.shows("waiting for a daemon")
    if isinstance(way, str):
        process.type(way)
    else:
        process.process.send_signal(way)
    assert await process.ended() == 0
    assert process.restored


@pytest.mark.parametrize("command", ["monitor", "drive"])
async def test_without_rich_it_says_what_to_install(terminal: Any, command: str) -> None:
    code = (
        "import sys; sys.modules['rich'] = None; from yahboomd.cli.main import main; "
        f"sys.exit(main(['{command}']))"
    )
    process = terminal(code=code)
    assert await process.ended() == 69
    await eventually(lambda: "-m pip install" in process.written)
