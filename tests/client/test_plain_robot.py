"""The form without asyncio; the daemon runs in the test's loop, the program in a thread."""

from __future__ import annotations

import asyncio
import inspect
import threading
from typing import Any

import pytest
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.client import AsyncRobot, BusError, NoDaemon, PoseSample, Robot

pytestmark = pytest.mark.usefixtures("fake_zenoh")

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
