"""Whatever fails inside, the wheels stop and the process ends, so that it can be restarted.

A real bus and a real loop: errors are raised outside of every handler.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from pathlib import Path
from typing import Any

import pytest
from robot_bench import steps_of
from zenoh_fixtures import eventually

from yahboomd.core.clock import Schedule
from yahboomd.core.daemon.estop import latch

pytestmark = pytest.mark.realtime


def broken(*_: object, **__: object) -> Any:
    raise ZeroDivisionError("put here by a test")


TASKS = ["supervisor", "control", "status", "link-writer", "link-poller", "port-watch", "callback"]


@pytest.mark.cases(2)
@pytest.mark.parametrize("name", TASKS)
async def test_a_task_that_is_cancelled_ends_the_daemon_with_the_wheels_at_rest(
    inner: Any, name: str
) -> None:
    await inner.driven()
    next(task for task in asyncio.all_tasks() if task.get_name() == name).cancel()
    await inner.ends_by_itself_at_rest()


# The decoder of commands runs in a callback of the bus: the control step alone would not notice.
PLACES = [
    "yahboomd.core.daemon.commands.decode_command",
    *(f"yahboomd.core.daemon.control.Controller.{name}" for name in ("control_step", "_drive")),
]


@pytest.mark.cases(2)
@pytest.mark.parametrize("place", PLACES)
async def test_an_error_in_the_control_path_ends_the_daemon_with_the_wheels_at_rest(
    inner: Any, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    await inner.driven()
    monkeypatch.setattr(place, broken)
    inner.session.put("cmd_vel", b'{"vx": 0.3}')
    await inner.ends_by_itself_at_rest()


async def test_an_estop_that_cannot_be_published_stops_the_wheels_and_its_file_is_written_again(
    inner: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(latch, "RESTORE_EVERY_S", 0.01)
    await inner.driven()
    monkeypatch.setattr(inner.daemon._publisher, "event", broken)
    inner.session.put("yahboomd/estop", b"")
    await eventually(lambda: inner.standing)
    assert not inner.task.done()
    assert inner.daemon._controller.state()[0] == "estopped"
    file = tmp_path / "estop"
    await eventually(file.exists)
    file.unlink()
    await eventually(file.exists)


@pytest.mark.nightly
async def test_a_service_that_fails_answers_and_the_robot_drives_on(
    inner: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    await inner.driven()
    monkeypatch.setattr(inner.daemon._controller, "set_pose", broken)
    replies = await asyncio.to_thread(
        lambda: list(inner.session.get("yahboomd/odometry/reset", timeout=60.0))
    )
    assert b"failed" in bytes(replies[0].ok.payload)
    await inner.driven()
    assert not inner.task.done()


async def test_the_watchdog_is_fed_by_control_steps_alone(
    inner_with: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        environ = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "60000"}
        ceased: list[bool] = []
        ring, advance = Schedule._ring, Schedule.advance
        monkeypatch.setattr(Schedule, "_ring", lambda each: None if ceased else ring(each))
        monkeypatch.setattr(
            Schedule, "advance", lambda each, at: None if ceased else advance(each, at)
        )
        inner = inner_with(environ)
        await inner.driven()

        def heard() -> bytes:
            words = b""
            with contextlib.suppress(BlockingIOError):
                while True:
                    words += manager.recv(4096) + b"\n"
            return words

        await eventually(lambda: b"WATCHDOG=1" in heard())
        # The loop runs on, timers ring, the status goes out; only the control steps cease.
        ceased.append(True)
        await asyncio.sleep(0.1)
        heard()
        steps = steps_of(inner.daemon._controller)
        for _ in range(40):
            inner.daemon.changed()
            await asyncio.sleep(0.02)
        assert b"WATCHDOG=1" not in heard()
        assert len(steps) <= 1
