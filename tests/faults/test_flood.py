"""In any flood the e-stop acts, the polls keep their schedule, and memory is bounded.

The control path runs on virtual time, for exact figures. Real processes then flood a real daemon:
each occupies every core, so they run one after the other, and nothing there is judged by time.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fault_bench import DIALECTS, MS, RATES_HZ, FaultBench, first_stop_ns
from real_robot import DRIVER, Client, RealRobot, wait_for

from yahboomd.core.bus.subscriptions import RING
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

GARBAGE = b"\xff\x00garbage" * 20
PAYLOADS = {"commands": b'{"vx": 0.3}', "garbage": GARBAGE, "megabytes": b"{" + b" " * 1_000_000}


@pytest.mark.cases(1)
@pytest.mark.parametrize("payload", PAYLOADS.values(), ids=PAYLOADS)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_under_20_kHz_the_estop_is_on_the_wire_within_50_ms_and_the_polls_are_on_time(
    tmp_path: Path, dialect: str, payload: bytes
) -> None:
    simulation = SimulationOptions(dialect=dialect)  # type: ignore[arg-type]
    async with FaultBench(tmp_path, (), simulation) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        readings, began_ns = len(bench.heard.estimates), bench.clock.now_ns()
        for number in range(20_000):
            bench.payload(payload if number % 2 else b'{"vx": 0.31}')
            if number % 20 == 0:
                await asyncio.sleep(0.001)
        passed_s = (bench.clock.now_ns() - began_ns) / 1e9
        expected = passed_s * RATES_HZ[dialect]
        assert len(bench.heard.estimates) - readings >= 0.95 * expected
        assert min(bench.rim_speeds) > 0.2
        now_ns = bench.clock.now_ns()
        bench.operator.engage_estop("a test")
        for number in range(2_000):
            bench.payload(payload)
            if number % 20 == 0:
                await asyncio.sleep(0.001)
        assert first_stop_ns(bench.orders_since(now_ns)) - now_ns <= 50 * MS
        await asyncio.sleep(0.5)
        assert bench.standing


def real(test: Callable[..., None]) -> Callable[..., None]:
    """A flood by real processes."""
    for mark in (pytest.mark.realtime, pytest.mark.nightly, pytest.mark.xdist_group("floods")):
        test = mark(test)
    return test


PROGRAM = Path(__file__).parents[1] / "plugins" / "zenoh_flood_process.py"


@contextlib.contextmanager
def processes(*commands: list[str]) -> Iterator[None]:
    """Programs of Python's that run during the block; each has printed its first line."""
    with contextlib.ExitStack() as stack:
        for command in commands:
            process = subprocess.Popen(
                [sys.executable, *command], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline()
        yield


def flood(robot: RealRobot, what: dict[str, Any]) -> list[str]:
    """A client that sends as fast as it can, unless it is asked to be slower."""
    return [str(PROGRAM), json.dumps({"endpoint": robot.endpoint, "hz": 1_000_000} | what)]


def memory_mb(robot: RealRobot, name: str) -> float:
    """The memory that the daemon has in use (``VmRSS``), or ever had (``VmHWM``)."""
    for line in Path(f"/proc/{robot.daemon.process.pid}/status").read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) / 1024
    raise AssertionError("no such process")


@pytest.fixture
def app(robot: RealRobot, client: Callable[..., Client]) -> Client:
    """Hears the status alone, and so hears it in time."""
    app = client("client", robot.endpoint, prefix="yahboomd/status")
    app.in_state("standing")
    return app


@pytest.fixture
def robot(real_robot: Callable[..., RealRobot]) -> RealRobot:
    return real_robot()


def counted(app: Client, counter: str) -> int:
    """A counter of the newest status."""
    return int(app.latest("status")["command"].get(counter, 0))


COMMANDS = {"key": "cmd_vel", "how": "put", "payload": '{"vx": 0.3}', "hz": 20_000}
PAYLOAD_OF_1_MB = COMMANDS | {"payload": "{" + " " * 99, "times": 10_000}
FLOODS = {
    "megabytes from one": [PAYLOAD_OF_1_MB],
    "all from many": [COMMANDS, COMMANDS | {"payload": "garbage" * 20}, PAYLOAD_OF_1_MB],
}
MOST_MB = 2 * RING + 32
"""The most memory that a flood of megabytes may occupy: a full ring, another that the loop has just
taken, and the network's own buffers. In the test some gigabytes are sent."""


@real
@pytest.mark.parametrize("kinds", FLOODS.values(), ids=FLOODS)
def test_while_processes_flood_the_estop_acts_the_polls_go_on_and_memory_is_bounded(
    robot: RealRobot, app: Client, kinds: list[dict[str, Any]]
) -> None:
    def driving() -> bool:
        return min(robot.truth()[-1].speed_m_s) > 0.3

    with processes(["-c", DRIVER, robot.endpoint, "cmd_vel/teleop"]):
        wait_for(driving, "the wheels turn")
        before_mb = memory_mb(robot, "VmRSS")
        with processes(*(flood(robot, kind) for kind in kinds)):
            first, heard = app.latest("status"), len(app.samples["status"])
            wait_for(lambda: len(app.samples["status"]) >= heard + 8, "eight statuses")
            assert app.latest("status")["link"]["readings"] > first["link"]["readings"]
            assert memory_mb(robot, "VmRSS") - before_mb < MOST_MB
            wait_for(driving, "it drives all the same")
            app.session.put("yahboomd/estop", b"{}")
            wait_for(robot.stands, "they stand")
        assert app.in_state("estopped")["why"].startswith("Emergency stop")
        robot.settled_truth()
    assert robot.daemon.process.poll() is None
    assert "Traceback" not in robot.daemon.output


ESTOP = {"key": "yahboomd/estop", "payload": '{"engaged": false}'}


@real
@pytest.mark.parametrize("how", ["put", "get"])
def test_no_estop_is_lost_and_none_caused_while_another_client_floods_its_key_with_refusals(
    robot: RealRobot, app: Client, how: str
) -> None:
    with processes(flood(robot, ESTOP | {"how": how})):
        wait_for(lambda: counted(app, "release_refused") > 1_000, "the flood")
        assert counted(app, "estops") == 0
        for number in range(4):
            if number % 2:
                app.session.put("yahboomd/estop", b"{}")
            else:
                assert app.ask("yahboomd/estop", b"{}")["success"]
            app.in_state("estopped")
            wait_for(lambda: app.ask("yahboomd/estop/reset")["success"], "the release")
            app.in_state("standing")
        refused = counted(app, "release_refused")
        wait_for(lambda: counted(app, "release_refused") > refused, "the flood goes on")
    assert counted(app, "estops") == 4
    assert "Traceback" not in robot.daemon.output


MEGABYTES = {"attachment": 15_000_000}
CARRIED = {
    "commands": (COMMANDS | {"hz": 1_000_000}, "command", "oversize"),
    "samples on the e-stop": (ESTOP | {"how": "put"}, "command", "estops_unread"),
    "queries": ({"key": "yahboomd/board", "how": "get"}, "bus", "requests_refused"),
}


@real
@pytest.mark.parametrize(("what", "part", "counter"), CARRIED.values(), ids=CARRIED)
def test_memory_is_bounded_whatever_samples_and_queries_carry(
    robot: RealRobot, app: Client, what: dict[str, Any], part: str, counter: str
) -> None:
    before_mb = memory_mb(robot, "VmHWM")
    large = flood(robot, what | MEGABYTES)
    small = [] if part == "bus" else [flood(robot, what | {"hz": 5_000})]
    with processes(large, large, *small):
        wait_for(lambda: app.latest("status")[part].get(counter, 0) > 24, "0.36 gigabytes", 300.0)
        grown_mb = memory_mb(robot, "VmHWM") - before_mb
    print(f"{grown_mb:+.1f} MB at most")
    assert grown_mb < 160
