"""The form without asyncio; the daemon runs in the test's loop, the program in a thread."""

from __future__ import annotations

import asyncio
import inspect
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.client import AsyncRobot, BusError, NoDaemon, PoseSample, Robot
from yahboomd.client.repeater import ZEROS_NS

pytestmark = pytest.mark.realtime

ZERO = (0.0, 0.0)


async def test_a_program_drives_reads_and_stops_at_its_end(fake_daemon: Any) -> None:
    daemon = await fake_daemon()

    def program() -> list[int]:
        with Robot(daemon.endpoint) as robot:
            assert robot.alive
            assert robot.status == daemon.status
            assert robot.drive(0.2, 0.5, for_s=60.0)
            seqs = []
            for sample in robot.samples(PoseSample):
                seqs.append(sample.seq)
                if len(seqs) == 4:
                    break
            assert robot.commanded is not None
            assert robot.estop() == "The emergency stop is engaged."
            assert robot.release() == "Released."
            robot.drive(0.1, for_s=60.0)
            return seqs

    seqs = await asyncio.to_thread(program)
    assert seqs == list(range(seqs[0], seqs[0] + 4))
    assert daemon.velocities[0] == (0.2, 0.5)
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])


def test_methods_have_the_arguments_and_docstrings_of_the_asyncio_form() -> None:
    own = {"newest", "samples", "on", "close", "moves"}
    shared = {
        name
        for name, method in inspect.getmembers(Robot, inspect.isfunction)
        if not name.startswith("_") and hasattr(AsyncRobot, name)
    } - own
    assert {"drive", "stop", "finished", "get", "estop", "set_pose"} <= shared
    for name in shared:
        ours, theirs = getattr(Robot, name), getattr(AsyncRobot, name)
        assert inspect.signature(ours) == inspect.signature(theirs)
        assert ours.__doc__ == theirs.__doc__


async def test_a_callback_may_drive_and_may_not_wait(fake_daemon: Any) -> None:
    daemon = await fake_daemon()

    def program() -> str:
        refused: list[str] = []

        def called(_pose: PoseSample) -> None:
            robot.drive(0.2)
            try:
                robot.estop()
            except RuntimeError as error:
                refused.append(str(error))

        with Robot(daemon.endpoint) as robot:
            end = robot.on(PoseSample, called)
            for _ in robot.samples(PoseSample):
                if refused:
                    break
            end()
        return refused[0]

    assert "may not wait" in await asyncio.to_thread(program)
    await eventually(lambda: (0.2, 0.0) in daemon.velocities)
    assert daemon.asked == []


async def test_an_exception_stops_it_too_and_comes_through(fake_daemon: Any) -> None:
    daemon = await fake_daemon()

    def program() -> None:
        with Robot(daemon.endpoint) as robot:
            robot.drive(0.2, for_s=60.0)
            raise LookupError

    with pytest.raises(LookupError):
        await asyncio.to_thread(program)
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])


async def test_a_program_that_hangs_stops_driving(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    hung = asyncio.Event()

    def program(loop: asyncio.AbstractEventLoop) -> None:
        with Robot(daemon.endpoint, deadman_s=0.2) as robot:
            robot.drive(0.2)
            # Nothing of this thread's runs meanwhile.
            asyncio.run_coroutine_threadsafe(hung.wait(), loop).result()

    running = asyncio.create_task(asyncio.to_thread(program, asyncio.get_running_loop()))
    await eventually(lambda: ZERO in daemon.velocities)
    hung.set()
    await running


async def test_samples_end_where_none_comes_in_time(fake_daemon: Any) -> None:
    daemon = await fake_daemon(namespace="bot1")

    def program() -> list[PoseSample]:
        with Robot(daemon.endpoint, namespace="bot1") as robot:
            asyncio.run_coroutine_threadsafe(daemon.stop(), loop).result()
            return list(robot.samples(PoseSample, timeout_s=0.2))

    loop = asyncio.get_running_loop()
    assert len(await asyncio.to_thread(program)) <= 1


def test_without_a_daemon_entering_raises_and_leaves_no_thread_behind() -> None:
    robot = Robot(free_endpoint(), wait_s=0.0)
    with pytest.raises(NoDaemon), robot:
        pass
    assert robot._thread is None


def test_a_robot_that_is_not_open_says_how_to_use_it() -> None:
    with pytest.raises(BusError, match=r"with Robot"):
        Robot().drive(0.1)


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


async def test_calls_that_wait_in_other_threads_end_with_the_robot(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    ended: list[BusError] = []

    def wait(robot: Robot) -> None:
        try:
            robot.wait_alive()
        except BusError as error:
            ended.append(error)

    def program() -> None:
        with Robot(daemon.endpoint) as robot:
            # It waits for a daemon that never comes back.
            asyncio.run_coroutine_threadsafe(daemon.stop(), loop).result()
            while robot.alive:
                threading.Event().wait(0.01)
            waiting = threading.Thread(target=wait, args=[robot], daemon=True)
            waiting.start()
            while not robot._robot._connection._found._waiters:
                threading.Event().wait(0.01)
        waiting.join(PATIENCE_S)
        assert not waiting.is_alive()

    loop = asyncio.get_running_loop()
    await asyncio.to_thread(program)
    (error,) = ended
    assert "closed while this call waited" in str(error)


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
