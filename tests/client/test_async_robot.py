"""A client as a daemon receives it, and a daemon as a program sees it."""

from __future__ import annotations

import asyncio
import math
import os
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import daemon_samples
import msgspec
import pytest
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.client import (
    AsyncRobot,
    BusError,
    EventSample,
    NoDaemon,
    PoseSample,
    Refused,
    StatusSample,
    WheelsSample,
    connect,
)
from yahboomd.client.connection import client_options
from yahboomd.client.services import estop_payload
from yahboomd.client.streams import KEYS
from yahboomd.core.bus import keys
from yahboomd.core.bus.alarms import READ_BYTES
from yahboomd.core.bus.subscriptions import Subscription
from yahboomd.core.clock import SystemClock
from yahboomd.core.messages.codecs import estop_by

pytestmark = pytest.mark.usefixtures("fake_zenoh")

ZERO = (0.0, 0.0)


@pytest.mark.parametrize("way", ["normal", "exception", "cancellation"])
async def test_on_every_way_out_the_robot_stops(fake_daemon: Any, way: str) -> None:
    daemon = await fake_daemon()

    async def program() -> None:
        async with connect(daemon.endpoint) as robot:
            robot.drive(0.2, for_s=math.inf)
            await eventually(lambda: (0.2, 0.0) in daemon.velocities)
            if way == "exception":
                raise LookupError
            if way == "cancellation":
                await asyncio.Event().wait()

    running = asyncio.create_task(program())
    await eventually(lambda: (0.2, 0.0) in daemon.velocities)
    if way == "cancellation":
        running.cancel()
        # Again while it stops: it stops all the same.
        await eventually(lambda: ZERO in daemon.velocities)
        running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert running.cancelled() or isinstance(running.exception(), LookupError | None)
    await eventually(lambda: daemon.velocities[-1:] == [ZERO])


async def test_a_command_ends_with_the_daemon_and_is_not_sent_when_it_is_back(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture
) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        robot.drive(0.2, for_s=math.inf)
        await eventually(lambda: daemon.velocities)
        await daemon.stop()
        await eventually(lambda: not robot.alive)
        assert not await robot.finished()
        assert not robot.drive(0.3, for_s=math.inf)
        assert robot.counters.interrupted == 1
        assert robot.counters.dropped == 1
        assert robot.pose is None
        daemon.commands.clear()
        await daemon.start()
        await robot.wait_alive(PATIENCE_S)
        await eventually(lambda: robot.status)
        assert daemon.velocities == []
        assert robot.drive(0.1, for_s=math.inf)
        await eventually(lambda: (0.1, 0.0) in daemon.velocities)
    assert robot.counters.losses == 1
    assert "is gone" in caplog.text


async def test_samples_are_read_as_newest_as_stream_and_on_request(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        assert robot.status == daemon.status
        first = await eventually(lambda: robot.pose)
        assert isinstance(first, PoseSample)
        assert (await eventually(lambda: robot.wheels)).names == ("left", "right")
        seqs = []
        async for sample in robot.samples(PoseSample, depth=8):
            seqs.append(sample.seq)
            if len(seqs) == 3:
                break
        assert seqs == list(range(seqs[0], seqs[0] + 3))
        assert await robot.get(StatusSample) == daemon.status
        events = robot.samples(EventSample)
        coming = asyncio.create_task(anext(events))
        # The subscription has to become known first.
        while not coming.done():
            daemon.tell("It rains.")
            await asyncio.wait([coming], timeout=0.1)
        assert coming.result().message == "It rains."
        events.close()
        with pytest.raises(NoDaemon):
            await robot.get(WheelsSample, timeout_s=0.2)


async def test_a_slow_loop_gets_the_newest_pose_and_every_event(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        poses, events = robot.samples(PoseSample), robot.samples(EventSample)
        every = robot.samples(PoseSample, depth=64)
        heard: list[int] = []
        robot.on(PoseSample, lambda pose: heard.append(pose.seq))
        first = await anext(poses)
        await eventually(lambda: daemon.has_listener)
        for words in ("one", "two", "three"):
            daemon.tell(words)
        await eventually(lambda: len(heard) >= 8)
        # Of two subscriptions one may have got the last sample, and not yet the other.
        assert (await anext(poses)).seq >= heard[-2] > first.seq + 1
        assert poses.dropped > 0
        assert [(await anext(events)).message for _ in range(3)] == ["one", "two", "three"]
        queued = [(await anext(every)).seq for _ in range(4)]
        assert queued == list(range(queued[0], queued[0] + 4))
        assert every.dropped == 0


class Ahead(SystemClock):
    """A clock that jumps, as by a program that was busy."""

    ahead_ns = 0

    def now_ns(self) -> int:
        return super().now_ns() + self.ahead_ns


@pytest.mark.parametrize("depth", [None, 64])
async def test_a_loop_that_drives_by_old_poses_is_warned_once(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture, depth: int | None
) -> None:
    daemon = await fake_daemon()
    clock = Ahead()
    async with AsyncRobot(client_options(daemon.endpoint), clock=clock) as robot:
        poses, newest = robot.samples(PoseSample, depth=depth), robot.samples(PoseSample)
        # A stream that lost a sample holds one.
        await eventually(lambda: newest.dropped)
        clock.ahead_ns += 400_000_000
        if depth is not None:
            await anext(poses)
        assert "arrived" not in caplog.text
        for _ in range(2):
            lost = newest.dropped
            await eventually(lambda before=lost: newest.dropped > before)
            clock.ahead_ns += 400_000_000
            robot.drive(0.1)
            await anext(poses)
    assert caplog.text.count("The PoseSample taken arrived") == 1
    assert ("depth=64" in caplog.text) == (depth == 64)


@pytest.mark.cases(2)
@pytest.mark.parametrize("encoding", ["json", "msgpack"])
@pytest.mark.parametrize("version", ["first", "newer"])
async def test_a_daemon_of_another_version_is_read(
    fake_daemon: Any, caplog: pytest.LogCaptureFixture, version: str, encoding: Any
) -> None:
    daemon = await fake_daemon()
    daemon.payloads = daemon_samples.of_version(version, encoding)
    async with connect(daemon.endpoint) as robot:
        for message in set(KEYS) - {EventSample}:
            sample: Any = await eventually(lambda it=message: robot.newest(it))
            assert (
                sample.stamp_ns
                == msgspec.json.decode(daemon_samples.of_version(version)[KEYS[message]])[
                    "stamp_ns"
                ]
            )
        status = robot.status
        assert status is not None
        event = await anext(robot.samples(EventSample))
        robot.drive(0.1)
        if version == "newer":
            assert (status.state, event.severity, event.kind) == ("docked", "notice", "docked")
            # Facts that are known stay, those whose shape is not are left out.
            assert status.link == {**daemon_samples.status().link, "none": None, "deep": ANY}
            assert event.data == {"none": None}
            assert "The robot cannot drive. Its state is 'docked'" in caplog.text
        else:
            assert (status.state, status.driver_since_ns) == ("driving", None)
            assert status.link == status.command == {}
            assert "cannot drive" not in caplog.text


async def test_a_callback_is_called_for_each_sample_until_it_is_ended(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        seqs: list[int] = []
        end = robot.on(PoseSample, lambda pose: seqs.append(pose.seq))
        await eventually(lambda: len(seqs) >= 3)
        end()
        called = len(seqs)
        await eventually(lambda: (pose := robot.pose) and pose.seq > seqs[-1] + 1)
    assert seqs == list(range(seqs[0], seqs[0] + called))


async def test_services_are_called_and_a_refusal_is_raised_in_the_daemons_words(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        assert await robot.estop() == "The emergency stop is engaged."
        daemon.releases = False
        with pytest.raises(Refused, match="cmd_vel commands motion"):
            await robot.release()
        daemon.releases = True
        assert await robot.release() == "Released."
    assert daemon.asked == [keys.ESTOP, keys.ESTOP_RESET, keys.ESTOP_RESET]


@pytest.fixture
def papers(tmp_path: Path) -> Path:
    """As a person's file of a fleet, with nothing but the name."""
    path = tmp_path / "anna.json5"
    path.write_text('{"metadata": {"yahboomd_fleet": {"person": "anna"}}}')
    return path


async def test_with_a_persons_file_services_and_commands_go_by_the_keys_of_that_name(
    fake_daemon: Any, papers: Path
) -> None:
    daemon = await fake_daemon()
    daemon.know("anna")
    async with connect(daemon.endpoint, zenoh_file=papers) as robot:
        daemon.releases = False
        with pytest.raises(Refused, match="cmd_vel commands motion"):
            await robot.release()
        daemon.releases = True
        assert await robot.release() == "Released."
        robot.drive(0.1, for_s=math.inf)
        await eventually(lambda: (0.1, 0.0) in daemon.velocities)
    assert daemon.asked == [keys.own_key(keys.ESTOP_RESET, "anna")] * 2


async def test_a_service_without_a_key_of_that_name_is_asked_without_it_and_the_answer_tells(
    fake_daemon: Any, papers: Path
) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint, zenoh_file=papers, source=keys.CMD_VEL) as robot:
        words = await robot.release()
        robot.drive(0.1, for_s=math.inf)
        await eventually(lambda: (0.1, 0.0) in daemon.velocities)
    assert daemon.asked == [keys.ESTOP_RESET]
    assert words == (
        "Released. Asked without a proven name: nothing answers on yahboomd/estop/reset/by/anna."
    )


@pytest.mark.usefixtures("patience")
async def test_a_stop_with_a_persons_file_is_by_both_keys_and_first_by_the_one_of_that_name(
    fake_daemon: Any, papers: Path
) -> None:
    daemon = await fake_daemon()
    daemon.know("anna")
    async with connect(daemon.endpoint, zenoh_file=papers) as robot:
        assert await robot.estop() == "The emergency stop is engaged by name."
    assert daemon.asked == [keys.own_key(keys.ESTOP, "anna"), keys.ESTOP]


@pytest.mark.usefixtures("patience")
async def test_a_daemon_that_does_not_know_the_name_is_stopped_and_the_answer_tells(
    fake_daemon: Any, papers: Path
) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint, zenoh_file=papers) as robot:
        assert await robot.estop() == (
            "The emergency stop is engaged. Asked without a proven name: "
            "nothing answers on yahboomd/estop/by/anna."
        )
    assert daemon.asked == [keys.ESTOP]


async def test_a_session_can_be_joined_without_waiting_for_the_daemon(fake_daemon: Any) -> None:
    daemon = await fake_daemon(namespace="bot1")
    robot: AsyncRobot = connect(daemon.endpoint, namespace="bot2")
    await robot.join(0.0)
    assert not robot.alive
    assert not (await robot.request(keys.ESTOP, timeout_s=0.2)).answered
    await robot.close()


async def test_a_robot_is_entered_once(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    robot = connect(daemon.endpoint)
    async with robot:
        pass
    with pytest.raises(BusError, match="entered once"):
        await robot.join(0.0)


async def test_streams_that_ended_leave_nothing_behind(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        for _ in range(5):
            robot.samples(PoseSample).close()
        stream = robot.samples(PoseSample)
        assert sum(isinstance(each, Subscription) for each in robot.bus._declared) == 2
    # It ends with the robot, after the kept samples.
    assert all([isinstance(sample, PoseSample) async for sample in stream])


def test_an_emergency_stop_carries_a_name_that_the_daemon_reads() -> None:
    assert f"(pid {os.getpid()})" in estop_by(estop_payload())
    assert estop_by(estop_payload("Ann")) == "Ann"
    for long in ("navigation of the second floor, east wing", "\u00e4" * 60):
        assert len(estop_payload(long)) <= READ_BYTES
        assert long.startswith(estop_by(estop_payload(long)) or "not read")
