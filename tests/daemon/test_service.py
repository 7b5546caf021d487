"""The daemon as a whole in one process: real bus, simulated board in memory."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import logging
import socket
import threading
from collections.abc import AsyncIterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import pytest
import zenoh
from zenoh_fixtures import PATIENCE_S, eventually, free_endpoint

from yahboomd.blackbox.box_keeper import BoxKeeper
from yahboomd.core.bus import keys
from yahboomd.core.bus.publishers import PRIORITIES, BusPublisher
from yahboomd.core.clock import Schedule, SystemClock
from yahboomd.core.config import read
from yahboomd.core.daemon.black_box import MakesBlackBox
from yahboomd.core.daemon.logs import PatientHandler
from yahboomd.core.daemon.planes import Plane
from yahboomd.core.daemon.publisher import PUBLISHED
from yahboomd.core.daemon.service import Daemon
from yahboomd.core.standstill import STANDING_M_S
from yahboomd.ros2.ros2_plane import Ros2Plane
from yahboomd.simulation.memory import MemoryPort
from yahboomd.simulation.robot import SimulatedRobot

pytestmark = pytest.mark.realtime


class Running:
    """A daemon on the test's own loop, and its published samples."""

    def __init__(
        self,
        folder: Path,
        environ: Mapping[str, str] = MappingProxyType({}),
        planes: Sequence[Plane] = (Ros2Plane(),),
        black_box: MakesBlackBox = BoxKeeper,
    ) -> None:
        self.endpoint = free_endpoint()
        self.robot = SimulatedRobot()
        overrides = [
            f'zenoh.listen=["{self.endpoint}"]',
            "zenoh.connect=[]",
            "zenoh.namespace=bot1",
            f"estop.latch_file={folder / 'estop'}",
        ]
        self.config = read(None, environ={}, overrides=overrides).config
        environ = {
            "RUNTIME_DIRECTORY": str(folder / "run"),
            "STATE_DIRECTORY": str(folder / "state"),
            **environ,
        }
        self.daemon = Daemon(
            self.config,
            environ=environ,
            black_box=black_box,
            planes=planes,
            clock=SystemClock(),
            opener=self.open,
        )
        self.task = asyncio.create_task(self.daemon.run())
        self.samples: dict[str, list[zenoh.Sample]] = {}

    async def open(self) -> MemoryPort:
        port = MemoryPort(self.robot)
        port.open()
        return port

    async def listen(self) -> zenoh.Session:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([self.endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")

        def opened() -> zenoh.Session | None:
            try:
                return zenoh.open(config)
            except zenoh.ZError:
                return None

        self.session: zenoh.Session = await eventually(opened)
        self.session.declare_subscriber("bot1/yahboomd/**", self._hear)
        return self.session

    def _hear(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).rsplit("/", 1)[-1]
        self.samples.setdefault(name, []).append(sample)

    def decoded(self, name: str) -> list[dict[str, Any]]:
        return [json.loads(bytes(sample.payload)) for sample in self.samples.get(name, [])]

    async def drive(self) -> None:
        """Command motion until the wheels turn."""

        def turning() -> bool:
            self.session.put("bot1/cmd_vel", b'{"vx": 0.3}')
            return max(abs(motor.speed_m_s) for motor in self.robot.plant.motors) > 0.2

        await eventually(turning)

    async def state(self, wanted: str) -> dict[str, Any]:
        await eventually(
            lambda: self.decoded("status") and self.decoded("status")[-1]["state"] == wanted
        )
        return self.decoded("status")[-1]

    async def ask(self, key: str, payload: bytes | None = None) -> dict[str, Any]:
        def asked() -> dict[str, Any]:
            for reply in self.session.get(f"bot1/{key}", payload=payload, timeout=PATIENCE_S):
                assert reply.ok is not None
                answer: dict[str, Any] = json.loads(bytes(reply.ok.payload))
                return answer
            pytest.fail(f"{key} did not answer")

        return await asyncio.to_thread(asked)

    async def end(self) -> None:
        if not self.task.done():
            self.daemon.stop("the test's end")
        await asyncio.gather(self.task, return_exceptions=True)
        if hasattr(self, "session"):
            await asyncio.to_thread(self.session.close)


@pytest.fixture
async def running(tmp_path: Path) -> AsyncIterator[Running]:
    running = Running(tmp_path)
    await running.listen()
    yield running
    await running.end()


async def test_every_native_key_carries_its_one_type_and_encoding_with_its_qos(
    running: Running,
) -> None:
    await running.state("standing")
    await running.ask("yahboomd/odometry/reset")
    # This board has no inertial sensor.
    published = {key: message for key, message in PUBLISHED.items() if key != keys.IMU}
    await eventually(lambda: {key.partition("/")[2] for key in published} <= set(running.samples))
    for key, message in published.items():
        for sample in running.samples[key.partition("/")[2]]:
            assert str(sample.encoding) == f"application/json;{message.__name__}"
            assert sample.priority == zenoh.Priority.DATA_HIGH
            assert sample.congestion_control == zenoh.CongestionControl.DROP
    for key in ("yahboomd/pose", "yahboomd/board", "yahboomd/estop"):
        (reply,) = await asyncio.to_thread(lambda key=key: list(running.session.get(f"bot1/{key}")))
        assert reply.ok.priority == PRIORITIES["data"]
        assert reply.ok.congestion_control == zenoh.CongestionControl.BLOCK
    alive = running.session.liveliness().get("bot1/yahboomd/alive", timeout=PATIENCE_S)
    replies = await asyncio.to_thread(list, alive)
    assert [str(reply.ok.key_expr) for reply in replies] == ["bot1/yahboomd/alive"]


def fastest_m_s(running: Running) -> float:
    return max(abs(motor.speed_m_s) for motor in running.robot.plant.motors)


HELD_S = 3.0
"""The time for which a thread that others must not wait for is held."""


async def follow_and_stop(running: Running) -> None:
    """The wheels follow a command, an emergency stop, and a command after its release."""
    await running.drive()
    assert (await running.ask("yahboomd/estop"))["success"]
    await eventually(lambda: fastest_m_s(running) == 0.0)

    async def released() -> bool:
        return bool((await running.ask("yahboomd/estop/reset"))["success"])

    while not await released():
        await asyncio.sleep(0.05)
    await running.drive()


async def test_what_only_records_may_fail_and_the_wheels_follow_and_stop(
    running: Running,
) -> None:
    """Each of them is switched off, counted and named in the status, as long as there is one."""
    await running.state("standing")
    await running.drive()

    def fail(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    daemon = running.daemon
    box, publisher = daemon._box, daemon._publisher
    ((_, ros2),) = daemon._planes._started
    assert box._file is not None
    ring = box._file._path
    box._file.ring._store = fail
    for part in (publisher, ros2):
        for name in ("estimate", "imu", "battery", "event"):
            setattr(part, name, fail)
    ros2.status = fail  # type: ignore[method-assign]
    await follow_and_stop(running)
    await eventually(lambda: running.decoded("status")[-1]["command"]["recorder_failures"] >= 5)
    status = running.decoded("status")[-1]["command"]
    parts = "The black box", "The pose on the bus", "The events on the bus", "The status for ROS 2"
    for name in parts:
        assert f"{name}: OSError" in status["recorders_off"]
    assert (status["blackbox_recording"], status["blackbox_saving"]) == (0, 0)
    publisher.status = fail  # type: ignore[method-assign]
    daemon._controller.state = fail  # type: ignore[method-assign]
    await follow_and_stop(running)
    # Also while it ends.
    daemon.stop("the test")
    await running.task
    assert daemon.left_standing
    # It drove until the end, which waits until the wheels are measured to stand, and no longer.
    assert fastest_m_s(running) < STANDING_M_S
    # A ring that is left tells the next start that this daemon was killed.
    assert not ring.exists()


@pytest.mark.nightly
async def test_a_black_box_that_cannot_be_made_is_reported_and_the_wheels_follow_and_stop(
    tmp_path: Path,
) -> None:
    def broken(*_: object) -> NoReturn:
        raise RuntimeError("no memory that outlives the process")

    running = Running(tmp_path, black_box=broken)
    session = await running.listen()
    try:
        await running.state("standing")
        await running.drive()
        await follow_and_stop(running)
        status = running.decoded("status")[-1]["command"]
        assert (status["recorder_failures"], status["blackbox_recording"]) == (1, 0)
        assert "The black box: RuntimeError: no memory" in status["recorders_off"]
        (reply,) = await asyncio.to_thread(
            lambda: list(session.get("bot1/yahboomd/blackbox/save", payload=b"{}"))
        )
        answer = json.loads(bytes(reply.ok.payload))
        assert not answer["success"]
        assert "No black box could be made" in answer["message"]
    finally:
        await running.end()


async def test_a_bus_and_a_log_that_take_nothing_hold_up_neither_command_nor_stop(
    running: Running,
) -> None:
    """The threads of the bus and of the log are held for seconds, while it drives and stops."""
    await running.state("standing")
    held, gate = threading.Event(), threading.Event()

    def hold(*_: object, **__: object) -> None:
        held.set()
        gate.wait(PATIENCE_S)

    class Unread(io.StringIO):
        write = hold  # type: ignore[assignment]

    handler = PatientHandler(Unread())
    handler.writer.start()
    logging.getLogger("yahboomd").addHandler(handler)
    publisher = running.daemon._publisher
    every = [
        publisher._status,
        publisher._events,
        *(each for each, _ in publisher._reading_outlets),
    ]
    try:
        for each in every:
            assert isinstance(each, BusPublisher)
            for outlet in each._outlets:
                outlet.put = hold
        await eventually(held.is_set)
        until_s = asyncio.get_running_loop().time() + HELD_S
        while asyncio.get_running_loop().time() < until_s:
            await follow_and_stop(running)
        assert handler.queue.unfinished_tasks > 0
        # 256 samples wait, and the others are lost.
        await eventually(lambda: sum(each.counters.errors for each in every) > 0)
    finally:
        gate.set()
        logging.getLogger("yahboomd").removeHandler(handler)


async def test_a_command_outside_the_namespace_moves_nothing(running: Running) -> None:
    await running.state("standing")
    running.session.put("cmd_vel", b'{"vx": 0.3}')
    answer = await running.ask("yahboomd/board")
    assert answer["success"]
    count = len(running.samples["status"])
    await eventually(lambda: len(running.samples["status"]) >= count + 2)
    assert running.decoded("status")[-1]["command"].get("received", 0) == 0


@pytest.mark.cases(1)
@pytest.mark.parametrize("payload", [b"", b"anything", b'{"engaged": true}', b"\x00" * 9000])
async def test_any_payload_on_the_estop_key_engages_it(running: Running, payload: bytes) -> None:
    await running.state("standing")
    running.session.put("bot1/yahboomd/estop", payload)
    status = await running.state("estopped")
    assert "Emergency stop" in status["why"]


async def test_the_services_do_what_they_say(running: Running) -> None:
    await running.state("standing")
    assert (await running.ask("yahboomd/estop"))["success"]
    await running.state("estopped")
    assert (await running.ask("yahboomd/estop/reset"))["success"]
    await running.state("standing")
    answer = await running.ask("yahboomd/odometry/set_pose", b'{"x": 1, "y": 2, "theta": 0.5}')
    assert answer["success"]
    await eventually(lambda: running.decoded("pose")[-1]["x"] == pytest.approx(1.0))
    assert (await running.ask("yahboomd/odometry/reset"))["success"]
    await eventually(lambda: running.decoded("pose")[-1]["x"] == pytest.approx(0.0))
    refused = await running.ask("yahboomd/odometry/set_pose", b'{"x": "here"}')
    assert not refused["success"]
    assert "wrong_type" in refused["message"]
    empty = await running.ask("yahboomd/odometry/set_pose")
    assert not empty["success"]
    assert "no pose was sent. It takes x and y in metres and theta in radians" in empty["message"]
    config = await running.ask("yahboomd/config")
    assert config["data"]["zenoh"]["namespace"] == "bot1"
    board = await running.ask("yahboomd/board")
    assert board["data"]["version"] == "1.7.3"


async def test_the_end_leaves_the_wheels_at_rest_and_no_task(running: Running) -> None:
    await running.state("standing")
    await running.drive()
    running.daemon.stop("a test")
    await running.task
    assert max(abs(motor.speed_m_s) for motor in running.robot.plant.motors) < 0.03
    left = {task.get_name() for task in asyncio.all_tasks()} & {"supervisor", "control", "status"}
    assert left == set()


async def test_an_error_in_a_task_stops_the_wheels_and_ends_the_daemon(
    running: Running, monkeypatch: pytest.MonkeyPatch
) -> None:
    await running.state("standing")
    await running.drive()

    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(type(running.daemon._controller), "control_step", broken)
    with pytest.raises(BaseExceptionGroup):
        await running.task
    assert max(abs(motor.speed_m_s) for motor in running.robot.plant.motors) < 0.03


async def test_a_service_is_ready_once_the_port_that_it_listens_on_is_free(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    overrides = [
        f'zenoh.listen=["{endpoint}"]',
        "zenoh.connect=[]",
        f"estop.latch_file={tmp_path / 'estop'}",
    ]
    config = read(None, environ={}, overrides=overrides).config
    heard: list[bytes] = []

    def hear() -> list[bytes]:
        with contextlib.suppress(BlockingIOError):
            while True:
                heard.append(manager.recv(500))
        return heard

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        environ = {
            "RUNTIME_DIRECTORY": str(tmp_path),
            "STATE_DIRECTORY": str(tmp_path),
            "NOTIFY_SOCKET": manager.getsockname(),
        }
        daemon = Daemon(config, environ=environ, black_box=BoxKeeper)
        with socket.create_server((host, int(port))):
            task = asyncio.create_task(daemon.run())
            await eventually(hear)
            assert all(each.startswith(b"STATUS=waiting for the bus: ") for each in heard)
        await eventually(lambda: b"READY=1" in hear())
        daemon.stop("the test's end")
        await task


async def test_a_control_loop_that_stands_still_feeds_no_watchdog_though_all_else_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[bytes] = []
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)

        def fed() -> int:
            with contextlib.suppress(BlockingIOError):
                while True:
                    heard.append(manager.recv(500))
            return heard.count(b"WATCHDOG=1")

        stopped: list[bool] = []
        stands_still = asyncio.Event()
        ring = Schedule._ring

        def rings_until_stopped(schedule: Schedule) -> None:
            if stopped:
                stands_still.set()
            else:
                ring(schedule)

        advance = Schedule.advance

        def advances_until_stopped(schedule: Schedule, now_ns: int) -> None:
            if not stopped:
                advance(schedule, now_ns)

        monkeypatch.setattr(Schedule, "_ring", rings_until_stopped)
        monkeypatch.setattr(Schedule, "advance", advances_until_stopped)
        environ = {"NOTIFY_SOCKET": manager.getsockname(), "WATCHDOG_USEC": "300000"}
        running = Running(tmp_path, environ)
        await running.listen()
        await running.state("standing")
        await eventually(lambda: fed() > 3)
        stopped.append(True)
        await stands_still.wait()
        before, count = fed(), len(running.samples["status"])
        # Two seconds, in which a watchdog of 0.3 s would have been fed twenty times.
        await eventually(lambda: len(running.samples["status"]) >= count + 4)
        assert fed() == before
        await running.end()


@pytest.mark.cases(1)
@pytest.mark.parametrize("name", ["supervisor", "control", "status"])
async def test_a_task_that_is_cancelled_alone_ends_the_daemon_with_the_wheels_at_rest(
    running: Running, name: str
) -> None:
    await running.state("standing")
    await running.drive()
    next(task for task in asyncio.all_tasks() if task.get_name() == name).cancel()
    with pytest.raises(BaseExceptionGroup):
        await running.task
    assert max(abs(motor.speed_m_s) for motor in running.robot.plant.motors) < 0.03
