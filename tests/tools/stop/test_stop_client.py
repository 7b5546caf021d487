"""The bus half of stop, with something on a real bus that answers as a daemon does."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import AsyncIterator, Callable

import daemon_samples
import msgspec
import pytest
from zenoh_fixtures import free_endpoint

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.services import Response
from yahboomd.core.config import Config
from yahboomd.core.errors import BusError, Refused
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import ServiceReply, WheelsSample
from yahboomd.tools.stop.stop_client import engage, no_daemon, release

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("patience")]

CONFIG = Config()


class Robot:
    """A daemon whose wheels slow down, or do not, once its stop is engaged."""

    def __init__(self, bus: Bus, speeds_after_stop: list[float]) -> None:
        self.speeds_after_stop = speeds_after_stop
        self.engaged = 0
        self.released = True
        self._bus = bus
        self._wheels = bus.publisher(keys.WHEELS)
        self._status = bus.publisher(keys.STATUS)
        bus.serve(keys.ESTOP, lambda _request: self._engage(), fallback=lambda _: answer(False))
        bus.serve(
            keys.ESTOP_RESET, lambda _request: self._reset(), fallback=lambda _: answer(False)
        )

    async def publish(self) -> None:
        speed = 0.4
        while True:
            if self.engaged and self.speeds_after_stop:
                speed = self.speeds_after_stop.pop(0)
            if speed >= 0.0:
                self._wheels.put(encode(wheels(speed), "json"))
            self._status.put(encode(daemon_samples.status("waiting", why="No board yet."), "json"))
            await asyncio.sleep(0.01)

    def _engage(self) -> Response:
        self.engaged += 1
        return answer(True, "Emergency stop engaged.")

    def _reset(self) -> Response:
        return answer(self.released, "Released." if self.released else "cmd_vel commands motion.")


STAMPS_NS = itertools.count(0, 15_000_000)
"""Three samples prove that wheels stand."""


def wheels(speed_m_s: float) -> WheelsSample:
    return WheelsSample(
        stamp_ns=next(STAMPS_NS),
        seq=1,
        names=("left", "right"),
        ticks=(0, 0),
        position_rad=(0.0, 0.0),
        speed_m_s=(speed_m_s, -speed_m_s),
        command_m_s=(0.0, 0.0),
    )


def answer(success: bool, message: str = "") -> Response:
    return Response(payload=encode(ServiceReply(success=success, message=message), "json"))


@pytest.fixture
async def robot() -> AsyncIterator[Callable[..., Robot]]:
    endpoint = free_endpoint()
    bus = Bus(BusOptions(listen=(endpoint,), connect=()))
    await bus.open()
    tasks: list[asyncio.Task[None]] = []

    def start(speeds_after_stop: list[float]) -> Robot:
        robot = Robot(bus, speeds_after_stop)
        tasks.append(asyncio.create_task(robot.publish()))
        return robot

    start.endpoint = endpoint  # type: ignore[attr-defined]
    yield start
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    await bus.close()


async def test_the_stop_is_engaged_and_the_wheels_are_watched_until_they_stand(robot) -> None:
    daemon = robot([0.3, 0.2, 0.1, 0.04, 0.0])
    done = await engage((robot.endpoint,), CONFIG, within_s=60.0)
    assert daemon.engaged == 1
    assert done is not None
    assert done.stood
    assert done.words.startswith("Emergency stop engaged. The wheels stand.")
    assert daemon.speeds_after_stop == []


@pytest.mark.nightly
async def test_one_slow_sample_among_fast_ones_is_no_standstill(robot) -> None:
    robot([0.0, 0.0, 0.5])
    done = await engage((robot.endpoint,), CONFIG, within_s=1.0)
    assert done is not None
    assert not done.stood
    assert "still turn, at 0.50 m/s" in done.words


@pytest.mark.nightly
async def test_a_daemon_without_a_board_is_not_said_to_have_standing_wheels(robot) -> None:
    daemon = robot([])
    daemon._wheels = type("Unheard", (), {"put": staticmethod(lambda _payload: None)})()
    done = await engage((robot.endpoint,), CONFIG, within_s=1.0)
    assert done is not None
    assert not done.stood
    assert "cannot see whether the wheels stand. Look at them" in done.words


async def test_nothing_is_sent_where_no_daemon_listens() -> None:
    assert await engage((free_endpoint(),), CONFIG) is None


async def test_a_release_is_passed_on_and_so_is_its_refusal(robot) -> None:
    daemon = robot([])
    endpoints = (robot.endpoint,)
    assert await asyncio.to_thread(release, endpoints, CONFIG) == "Released."
    daemon.released = False
    with pytest.raises(Refused, match="cmd_vel commands motion") as refused:
        await asyncio.to_thread(release, endpoints, CONFIG)
    assert refused.value.exit_code == 1


@pytest.mark.nightly
async def test_a_release_with_a_persons_file_is_by_the_key_of_that_name(robot, tmp_path) -> None:
    papers = tmp_path / "anna.json5"
    papers.write_text('{"metadata": {"yahboomd_fleet": {"person": "anna"}}}')
    config = Config.model_validate({"zenoh": {"config": str(papers)}})
    own = keys.own_key(keys.ESTOP_RESET, "anna")
    daemon = robot([])
    words = await asyncio.to_thread(release, (robot.endpoint,), config)
    assert words == f"Released. Asked without a proven name: nothing answers on {own}."
    by_name = answer(True, "Released by name.")
    daemon._bus.serve(own, lambda _request: by_name, fallback=lambda _: answer(False))
    words = await asyncio.to_thread(release, (robot.endpoint,), config)
    assert words == "Released by name."


@pytest.mark.nightly
async def test_a_stop_with_a_persons_file_is_by_the_key_of_that_name_too(robot, tmp_path) -> None:
    papers = tmp_path / "anna.json5"
    papers.write_text('{"metadata": {"yahboomd_fleet": {"person": "anna"}}}')
    config = Config.model_validate({"zenoh": {"config": str(papers)}})
    own = keys.own_key(keys.ESTOP, "anna")
    daemon = robot([0.0])
    done = await engage((robot.endpoint,), config, within_s=60.0)
    assert done is not None
    assert f"Asked without a proven name: nothing answers on {own}." in done.words
    by_name = answer(True, "Engaged by name.")
    daemon._bus.serve(own, lambda _request: by_name, fallback=lambda _: answer(False))
    done = await engage((robot.endpoint,), config, within_s=60.0)
    assert done is not None
    assert done.words.startswith("Engaged by name. The wheels stand.")
    assert (done.stood, done.daemons, daemon.engaged) == (True, 1, 2)


async def test_another_robots_daemon_is_left_alone(robot) -> None:
    daemon = robot([0.0])
    other = Config.model_validate({"zenoh": {"namespace": "bot2"}})
    assert await engage((robot.endpoint,), other) is None
    assert daemon.engaged == 0
    with pytest.raises(BusError, match="No daemon answers"):
        await asyncio.to_thread(release, (robot.endpoint,), other)


def test_the_message_names_every_place_that_was_tried() -> None:
    assert "tcp/a:1 or tcp/b:2" in str(no_daemon(("tcp/a:1", "tcp/b:2")))
    assert msgspec.json.encode(no_daemon(("tcp/a:1",)).exit_code) == b"69"
