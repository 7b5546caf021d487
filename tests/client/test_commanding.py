"""The commands of a client, as a daemon receives them."""

from __future__ import annotations

import asyncio
import math
import time
from contextlib import suppress
from typing import Any

import daemon_samples
import pytest
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.client import AsyncRobot, CommandEnded, PoseSample, connect
from yahboomd.client.connection import client_options
from yahboomd.core.clock import SystemClock

pytestmark = pytest.mark.usefixtures("fake_zenoh")

ZERO = (0.0, 0.0)


async def test_a_command_is_repeated_for_its_time_then_zeros_end_it(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint, label="a test") as robot:
        assert robot.drive(0.2, 0.5, for_s=60.0)
        await eventually(lambda: daemon.velocities.count((0.2, 0.5)) >= 3)
        assert robot.drive(0.2, 0.5, for_s=0.3)
        assert robot.commanded is not None
        assert await robot.finished()
        assert robot.commanded is None
        assert robot.counters.deadman == 0
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])
    first = daemon.velocities.index(ZERO)
    assert set(daemon.velocities[:first]) == {(0.2, 0.5)}
    assert set(daemon.velocities[first:]) == {ZERO}
    assert len(daemon.velocities) > first + 1
    stamps = [command["stamp_ns"] for command in daemon.commands]
    assert stamps == sorted(stamps)
    assert daemon.commands[0]["source"] == "a test"


async def test_without_a_time_the_deadman_ends_it_and_says_so(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint, deadman_s=0.2) as robot:
        robot.drive(0.2)
        await robot.finished()
        assert robot.counters.deadman == 1
    assert "drive() was not called again within 0.2 s" in caplog.text


async def test_a_stop_is_published_at_once_and_ends(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        robot.drive(0.2, for_s=math.inf)
        await eventually(lambda: (0.2, 0.0) in daemon.velocities)
        robot.stop()
        assert await robot.finished()
    await eventually(lambda: ZERO in daemon.velocities)
    assert (0.2, 0.0) not in daemon.velocities[daemon.velocities.index(ZERO) :]


async def test_a_robot_that_will_not_move_says_why(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = await fake_daemon()
    daemon.status = daemon_samples.status("fault", why="Left wheel: no counts.")
    async with connect(daemon.endpoint) as robot:
        robot.drive(0.2)
        robot.drive(0.2)
    assert caplog.text.count("The robot cannot drive. Left wheel: no counts.") == 1


async def test_a_velocity_that_no_robot_has_is_refused_at_once(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        with pytest.raises(ValueError, match="finite"):
            robot.drive(math.nan)
        with pytest.raises(ValueError, match="faster than any robot"):
            robot.drive(1e39)
        with pytest.raises(ValueError, match="for_s"):
            robot.drive(0.1, for_s=0.0)
        with pytest.raises(ValueError, match="PoseSample"):
            robot.samples(type(robot.counters))
        with pytest.raises(ValueError, match="depth"):
            robot.samples(PoseSample, depth=0)
    assert daemon.velocities == []


@pytest.mark.cases(2)
@pytest.mark.parametrize("wrong", ["0.2", True, None, [0.2], b"1"])
async def test_what_is_no_number_is_refused_by_its_name(fake_daemon: Any, wrong: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        with pytest.raises(TypeError, match=r"vx must be a number, not .*float\(\)"):
            robot.drive(wrong)
        with pytest.raises(TypeError, match="wz must be a number"):
            robot.drive(0.1, wrong)
        if wrong is not None:
            with pytest.raises(TypeError, match="for_s must be a number"):
                robot.drive(0.1, for_s=wrong)
    assert daemon.velocities == []


class Sleepy(SystemClock):
    """The clock of a machine that may be suspended."""

    slept_ns = 0

    def suspended_ns(self) -> int:
        return self.slept_ns


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("config", "source", "bound_ms"),
    [
        (None, "cmd_vel", 500),
        (None, "cmd_vel/teleop", 300),
        ({"command": {"timeout_s": 5.0}}, "cmd_vel", 5000),
        ({"command": {"sources": {"cmd_vel": {"timeout_s": 7.0}}}}, "cmd_vel", 7000),
    ],
)
async def test_after_a_pause_as_long_as_the_daemon_waits_the_robot_does_not_start_by_itself(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture, config: Any, source: str, bound_ms: int
) -> None:
    daemon = await fake_daemon(config=config)
    clock = Sleepy()
    async with AsyncRobot(client_options(daemon.endpoint), source=source, clock=clock) as robot:
        robot.drive(0.2, for_s=60.0)
        # The second beat is the first that can see it.
        await eventually(lambda: robot.counters.published >= 3)
        if config is not None:
            # A shorter pause ends nothing: the robot did not stop.
            clock.slept_ns += (bound_ms - 2000) * 1_000_000
            published = robot.counters.published
            await eventually(lambda: robot.counters.published > published + 2)
            assert robot.counters.interrupted == 0
        clock.slept_ns += bound_ms * 1_000_000
        with pytest.raises(CommandEnded, match=r"did not run for \d\.\d s.* Call drive\(\) again"):
            await robot.finished()
        assert robot.counters.interrupted == 1
        assert robot.commanded is None
        # A stop is an end as any other.
        robot.stop()
        assert await robot.finished()
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])
    assert "did not run for" in caplog.text


async def test_a_command_lasts_at_a_daemon_that_waits_less_than_the_rate_asks(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon(config={"command": {"timeout_s": 0.15}})
    async with connect(daemon.endpoint, rate_hz=5.0) as robot, asyncio.timeout(PATIENCE_S):
        lasted = False
        # On a busy machine a pause may end some.
        while not lasted:
            robot.drive(0.2, for_s=0.6)
            with suppress(CommandEnded):
                lasted = await robot.finished()


async def test_a_command_that_waited_for_a_program_that_did_not_run_moves_nothing(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon(config={"command": {"timeout_s": 2.0}})
    clock = Sleepy()
    async with AsyncRobot(client_options(daemon.endpoint), clock=clock) as robot:
        assert robot.drive(0.2, for_s=60.0)
        clock.slept_ns = 3_000_000_000
        with pytest.raises(CommandEnded, match=r"did not run for 3\.\d s.* Call drive\(\) again"):
            await robot.finished()
        assert robot.counters.interrupted == 1
        # As after a computation of a program that knows its present command.
        clock.slept_ns = 6_000_000_000
        assert robot.drive(0.3, for_s=0.2)
        assert await robot.finished()
    await eventually(lambda: (0.3, 0.0) in daemon.velocities)
    assert (0.2, 0.0) not in daemon.velocities


async def test_a_command_that_does_not_change_keeps_its_rhythm(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint, rate_hz=5.0) as robot:
        begun_s = time.monotonic()
        for _ in range(20):
            robot.drive(0.2, for_s=60.0)
            await asyncio.sleep(0.006)
        assert robot.counters.published <= 2 + 5.0 * (time.monotonic() - begun_s)
        robot.drive(0.3, for_s=60.0)
        await eventually(lambda: (0.3, 0.0) in daemon.velocities)


async def test_a_source_that_the_daemon_does_not_know_is_named_with_what_adds_it(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint, source="cmd_vel/mine") as robot:
        robot.drive(0.1, for_s=60.0)
        await eventually(lambda: "accepts no commands on cmd_vel/mine" in caplog.text)
    assert """--set 'command.sources."cmd_vel/mine".priority=10'""" in caplog.text


async def test_a_daemon_that_was_lost_is_not_one_that_accepts_no_commands(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        robot.drive(0.1, for_s=math.inf)
        # For longer than a source without a subscriber takes to be known.
        await eventually(lambda: robot.counters.published > 25)
        await daemon.stop()
        assert not await robot.finished()
    assert "is gone" in caplog.text
    assert "accepts no commands" not in caplog.text
