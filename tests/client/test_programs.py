"""Programs in processes of their own, which drive over a real bus."""

from __future__ import annotations

import asyncio
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.client.commanding import ZEROS_NS

pytestmark = pytest.mark.realtime

ZERO = (0.0, 0.0)


TWO_ROBOTS = """
import asyncio, os, signal, sys
from yahboomd.client import connect
async def drive(endpoint):
    async with connect(endpoint) as robot:
        robot.drive(0.2, for_s=60)
        while robot.counters.published < 2:
            await asyncio.sleep(0.01)
        print("drives", flush=True)
        await asyncio.Event().wait()
async def main():
    await asyncio.gather(*(drive(each) for each in sys.argv[1:]))
asyncio.run(main())
"""


async def test_sigterm_stops_each_robot_of_a_program(fake_daemon: Any) -> None:
    daemons = [await fake_daemon(), await fake_daemon()]
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", TWO_ROBOTS, *(each.endpoint for each in daemons)),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )
    assert process.stdout is not None
    for _ in daemons:
        assert await process.stdout.readline() == b"drives\n"
    process.terminate()
    assert await process.wait() == 128 + signal.SIGTERM
    for daemon in daemons:
        await eventually(lambda daemon=daemon: daemon.velocities[-1:] == [ZERO])


OPENED = """
import sys
import threading
from yahboomd.client import Robot
robot = Robot(sys.argv[1]).open()
robot.drive(0.2, for_s=60)
"""


async def test_a_program_that_ends_without_closing_stops_the_robot(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    process = await asyncio.create_subprocess_exec(sys.executable, "-c", OPENED, daemon.endpoint)
    assert await process.wait() == 0
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])


IMPATIENT = """
import signal, sys, threading
from yahboomd.client import Robot
with Robot(sys.argv[1]) as robot:
    robot.drive(0.2, for_s=60)
    # While the zeros are published.
    threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
"""


@pytest.mark.nightly
async def test_impatience_does_not_interrupt_the_stop(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", IMPATIENT, daemon.endpoint, stderr=asyncio.subprocess.DEVNULL
    )
    assert await process.wait() == -signal.SIGINT

    def stopped_for_ns() -> int:
        zeros = [each["stamp_ns"] for each in daemon.commands if each["vx"] == 0.0]
        return zeros[-1] - zeros[0] if zeros else 0

    await eventually(lambda: stopped_for_ns() >= 0.8 * ZEROS_NS)


INTERRUPTED = """
import sys
from yahboomd.client import PoseSample, Robot
def follow(robot):
    for pose in robot.samples(PoseSample):  # until Ctrl-C
        print(pose.x, flush=True)
with Robot(sys.argv[1]) as robot:
    follow(robot)
"""


@pytest.mark.nightly
async def test_control_c_shows_where_the_program_was_not_where_the_library_waited(
    fake_daemon: Any, tmp_path: Path
) -> None:
    daemon = await fake_daemon()
    program = tmp_path / "circle.py"
    program.write_text(INTERRUPTED)
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, program, daemon.endpoint),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    await process.stdout.readline()
    process.send_signal(signal.SIGINT)
    _, said = await process.communicate()
    assert process.returncode == -signal.SIGINT
    lines = said.decode().splitlines()
    places = [line for line in lines if line.startswith("  File")]
    assert len(places) == 2
    assert all(place.startswith(f'  File "{program}", line ') for place in places)
    assert lines[-1] == "KeyboardInterrupt"


async def test_the_program_of_the_readme_ends_silently_at_control_c_and_stops_the_robot(
    fake_daemon: Any, tmp_path: Path
) -> None:
    daemon = await fake_daemon()
    page = (Path(__file__).parents[2] / "README.md").read_text()
    text = page.split("```python\n")[1].split("```")[0]
    program = tmp_path / "circle.py"
    program.write_text(text.replace("Robot() as", f'Robot("{daemon.endpoint}") as'))
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-u", program),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    await process.stdout.readline()
    process.send_signal(signal.SIGINT)
    _, said = await process.communicate()
    assert (process.returncode, said) == (0, b"")
    await eventually(lambda: daemon.velocities[-1] == ZERO)


FORKED = """
import os, sys, time
from yahboomd.client import Robot
with Robot(sys.argv[1]) as robot:
    child = os.fork()
    if child == 0:
        try:
            robot.drive(0.3)
        except Exception as error:
            print(error, flush=True)
        sys.exit(3)
    deadline = time.monotonic() + 60
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        if time.monotonic() > deadline:
            os.kill(child, 9)
            os.waitpid(child, 0)
            sys.exit("the child hangs")
        time.sleep(0.02)
    print(os.waitstatus_to_exitcode(ended[1]), robot.drive(0.2, for_s=60))
"""


@pytest.mark.nightly
async def test_a_forked_process_neither_drives_nor_hangs_nor_stops_its_parents_robot(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-W", "ignore", "-c", FORKED, daemon.endpoint),
        stdout=asyncio.subprocess.PIPE,
    )
    output, _ = await process.communicate()
    first, second = output.decode().splitlines()
    assert "forked" in first
    assert second == "3 True"
    assert process.returncode == 0
    assert daemon.velocities[0] == (0.2, 0.0)
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])


@pytest.mark.cases(1)
@pytest.mark.parametrize("way", ["robot.close()", "sys.exit(4)"])
async def test_a_callback_that_ends_it_stops_the_robot_and_does_not_hang(
    fake_daemon: Any, way: str
) -> None:
    daemon = await fake_daemon()
    code = CALLED_BACK.replace("WAY", way)
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", code, daemon.endpoint), stderr=asyncio.subprocess.DEVNULL
    )
    try:
        async with asyncio.timeout(PATIENCE_S):
            assert await process.wait() == 0
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])


CALLED_BACK = """
import sys
import threading
from yahboomd.client import PoseSample, Robot
with Robot(sys.argv[1]) as robot:
    robot.drive(0.2, for_s=60)
    robot.on(PoseSample, lambda pose: WAY)
    for pose in robot.samples(PoseSample):
        pass
"""
