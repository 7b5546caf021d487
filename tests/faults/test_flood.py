"""In any flood the e-stop acts, the polls keep their schedule, and memory is bounded.

The control path runs on virtual time, for exact figures. Then real processes flood a real daemon,
and their figures are printed.
"""

from __future__ import annotations

import asyncio
import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fault_bench import DIALECTS, MS, RATES_HZ, FaultBench, first_stop_ns
from real_robot import DRIVER, Client, RealRobot, wait_for

from benchmarks.soak.tail import Wire, is_stop
from yahboomd.core.bus.subscriptions import RING
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

GARBAGE = b"\xff\x00garbage" * 20
PAYLOADS = {"commands": b'{"vx": 0.3}', "garbage": GARBAGE, "megabytes": b"{" + b" " * 1_000_000}


@pytest.mark.cases(4)
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


FLOOD = """
import pathlib, sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["' + sys.argv[1] + '"]')
while True:
    try:
        session = zenoh.open(config)
        break
    except zenoh.ZError:
        time.sleep(0.02)
payload = {
    "commands": b'{"vx": 0.3}',
    "garbage": bytes([255, 0]) + b"garbage" * 20,
    "megabytes": b"{" + b" " * 1_000_000,
}[sys.argv[2]]
publisher = session.declare_publisher("cmd_vel")
print("flooding", flush=True)
count, began, reported = 0, time.monotonic(), 0.0
while True:
    for _ in range(20):
        publisher.put(payload)
    count += 20
    passed = time.monotonic() - began
    if passed > reported + 0.5:
        reported = passed
        beside = pathlib.Path(sys.argv[3] + ".new")
        beside.write_text(str(count / passed))
        beside.replace(sys.argv[3])
    # The faster the better, up to 20 kHz.
    time.sleep(max(0.0, count / 20_000 - passed))
"""


@contextlib.contextmanager
def processes(*commands: list[str]) -> Iterator[None]:
    """Scripts that run during the block; each has printed its first line."""
    with contextlib.ExitStack() as stack:
        for command in commands:
            process = subprocess.Popen(
                [sys.executable, "-c", *command],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline()
        yield


def resident_mb(pid: int) -> float:
    """The memory that a process has in use."""
    for line in Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise AssertionError("no such process")


def readings_between(first: dict[str, Any], last: dict[str, Any]) -> tuple[float, float]:
    """The counts that came from one status to another, and the seconds between them."""
    passed_s = (last["stamp_ns"] - first["stamp_ns"]) / 1e9
    return last["link"]["readings"] - first["link"]["readings"], passed_s


MOST_MB = 2 * RING + 32
"""The most memory that a flood of megabytes may occupy: a full ring, another that the loop has just
taken, and the network's own buffers. In the test some gigabytes are sent."""

FLOODS = {
    "megabytes from one": ("streamed", ["megabytes"]),
    "all from many": ("polled", ["commands", "garbage", "megabytes", "garbage"]),
}


@pytest.mark.realtime
@pytest.mark.parametrize(("dialect", "kinds"), FLOODS.values(), ids=FLOODS)
def test_while_processes_flood_the_estop_acts_the_polls_go_on_and_memory_is_bounded(
    real_robot: Callable[..., RealRobot],
    client: Callable[..., Client],
    tmp_path: Path,
    request: pytest.FixtureRequest,
    dialect: str,
    kinds: list[str],
) -> None:
    heard = tmp_path / "heard"
    robot = real_robot(simulate=["--dialect", dialect, "--heard", str(heard)])
    wire = Wire(heard)
    request.addfinalizer(wire.close)
    app = client("client", robot.endpoint)
    app.in_state("standing")
    pid = robot.daemon.process.pid

    def next_status() -> dict[str, Any]:
        count = len(app.samples["status"])
        wait_for(lambda: len(app.samples["status"]) > count, "a status")
        return app.latest("status")

    def rate_hz(statuses: int) -> float:
        """Readings a second, over a number of statuses."""
        first = next_status()
        for _ in range(statuses):
            last = next_status()
        readings, passed_s = readings_between(first, last)
        return readings / passed_s

    with processes([DRIVER, robot.endpoint, "cmd_vel/teleop"]):
        wait_for(lambda: min(robot.truth()[-1].speed_m_s) > 0.3, "the wheels turn")
        quiet_hz = rate_hz(2)
        before_mb = resident_mb(pid)
        rates = [tmp_path / f"rate{number}" for number in range(len(kinds))]
        with processes(
            *(
                [FLOOD, robot.endpoint, kind, str(rate)]
                for kind, rate in zip(kinds, rates, strict=True)
            )
        ):
            flooded_hz = rate_hz(4)
            halfway_mb = resident_mb(pid)
            rate_hz(4)
            grown_mb = resident_mb(pid) - before_mb
            wait_for(lambda: min(robot.truth()[-1].speed_m_s) > 0.3, "it drives all the same")
            now_ns = time.monotonic_ns()
            app.session.put("yahboomd/estop", b"{}")
            stop = wait_for(lambda: wire.first(now_ns, is_stop), "the stop is on the wire")
            after_ms = (stop.t_ns - now_ns) / 1e6
            wait_for(robot.stands, "they stand")
            wait_for(lambda: all(rate.exists() for rate in rates), "every rate")
            floods = [
                f"{kind} at {float(rate.read_text()) / 1e3:.1f} kHz"
                for kind, rate in zip(kinds, rates, strict=True)
            ]
        print(
            f"{dialect}, {' and '.join(floods)}: "
            f"stop {after_ms:.1f} ms after the e-stop was sent, "
            f"{flooded_hz:.0f} readings a second after {quiet_hz:.0f}, "
            f"{grown_mb:+.1f} MB, {grown_mb + before_mb - halfway_mb:+.1f} MB of it late"
        )
        assert flooded_hz > 0.0
        assert grown_mb < MOST_MB
        assert app.in_state("estopped")["why"].startswith("Emergency stop")
        assert max(map(abs, robot.settled_truth().speed_m_s)) < 0.03
    assert robot.daemon.process.poll() is None
    assert "Traceback" not in robot.daemon.output
