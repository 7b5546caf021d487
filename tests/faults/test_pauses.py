"""A daemon that did not run for a while: stopped, starved, or on a machine that was suspended."""

from __future__ import annotations

import asyncio
import json
import re
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from fault_bench import DIALECTS, MS, STREAMS, FaultBench, is_stop
from real_robot import Client, RealRobot, wait_for

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import VirtualTimeLoop, on_virtual_time

S = 1000 * MS
ALARMS = {
    "runaway_fast",
    "runaway_against",
    "no_counts",
    "off_speed",
    "turns_without_command",
    "stop_not_obeyed",
    "disconnected",
    "board_reset",
}


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    return FaultBench(tmp_path, overrides, SimulationOptions(**simulation))  # type: ignore[arg-type]


def freeze(for_s: float) -> None:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.freeze(for_s)


def stamped(bench: FaultBench, vx: float, ago_s: float) -> bytes:
    return json.dumps({"vx": vx, "stamp_ns": bench.clock.wall_ns() - round(ago_s * 1e9)}).encode()


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("for_s", [0.35, 0.6, 0.9, 1.2, 1.5, 1.9])
@on_virtual_time
async def test_a_pause_of_the_process_accuses_neither_board_nor_wheels(
    tmp_path: Path, for_s: float, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        for phase in range(4):
            await bench.drive(2.0, 0.3)
            # At another moment of the board's period each time.
            await asyncio.sleep(0.005 * phase)
            freeze(for_s)
            await bench.drive(2.0, 0.3)
            assert min(bench.rim_speeds) > 0.25
        assert not ALARMS & set(bench.heard.kinds)
        assert bench.controller.counters["blind"] == 0
        assert bench.controller.counters["pauses"] == 4
        paused = [event for event in bench.heard.events if event.kind == "paused"]
        assert len(paused) == 4
        for event in paused:
            assert event.data is not None
            assert for_s <= event.data["duration_s"] <= for_s + 0.05


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("for_s", [0.6, 1.2, 1.9])
@on_virtual_time
async def test_what_was_commanded_before_a_pause_is_over_and_the_stop_is_the_first_word(
    tmp_path: Path, for_s: float, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        freeze(for_s)
        thaw_ns = bench.clock.now_ns()
        await asyncio.sleep(2.0)
        (at_ns, order), *_ = bench.orders_since(thaw_ns)
        assert is_stop(order)
        assert at_ns - thaw_ns <= 20 * MS
        assert all(is_stop(order) for _, order in bench.orders_since(thaw_ns))
        assert bench.standing
        assert not ALARMS & set(bench.heard.kinds)


@pytest.mark.cases(2)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_pause_of_a_robot_that_stands_is_no_reset(tmp_path: Path, dialect: str) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        for _ in range(3):
            await asyncio.sleep(1.0)
            freeze(0.9)
            await asyncio.sleep(1.0)
        assert bench.controller.counters["pauses"] == 3
        assert "odometry_discontinuity" not in bench.heard.kinds
        assert not ALARMS & set(bench.heard.kinds)
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.25


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("for_s", [0.6, 0.9, 1.2, 1.9])
@on_virtual_time
async def test_counters_that_came_nearer_to_zero_during_a_pause_are_no_reset(
    tmp_path: Path, for_s: float, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.5, 0.4)
        await bench.drive(1.0, -0.3)
        freeze(for_s)
        await bench.drive(1.5, -0.3)
        assert not ALARMS & set(bench.heard.kinds)
        assert max(bench.rim_speeds) < -0.25


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_pause_during_a_stop_gives_the_wheels_their_time_again(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        bench.operator.engage_estop("a test")
        await asyncio.sleep(0.02)
        freeze(1.0)
        await asyncio.sleep(2.0)
        assert bench.standing
        assert not ALARMS & set(bench.heard.kinds)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("for_s", [0.5, 1.5])
@on_virtual_time
async def test_a_wheel_that_runs_away_during_a_pause_is_cut_after_it(
    tmp_path: Path, for_s: float, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        bench.do("encoder-reversed left")
        freeze(for_s)
        await bench.drive(1.0, 0.3)
        assert bench.controller.state()[0] == "fault"
        assert any(event.wheel == "left" for event in bench.heard.events)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_commands_that_waited_for_a_paused_process_move_nothing(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        freeze(6.0)
        now_ns = bench.clock.now_ns()
        for _ in range(3):
            bench.command(0.5)
        await asyncio.sleep(1.0)
        assert bench.fastest_since(now_ns) < 0.01
        assert bench.arbiter.counters["after_pause"] == 3
        # A stop is obeyed at any age, and later commands drive.
        freeze(6.0)
        bench.command(0.0)
        assert bench.arbiter.counters["accepted"] == 1
        await asyncio.sleep(0.2)
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(1)
@pytest.mark.parametrize("for_s", [0.6, 6.0, 20.0])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_of_stamped_commands_that_waited_only_the_fresh_ones_move_anything(
    tmp_path: Path, for_s: float, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        for _ in range(40):
            bench.payload(stamped(bench, 0.3, 0.0))
            await asyncio.sleep(0.05)
        freeze(for_s)
        for n in range(int(for_s / 0.05)):
            bench.payload(stamped(bench, 0.5, for_s - 0.05 * n))
            if for_s - 0.05 * n > 0.5:
                assert bench.arbiter.current(bench.clock.now_ns()).twist.is_zero
        # The differences of the last 10 s show which commands are fresh; later there are none.
        driving = bench.arbiter.current(bench.clock.now_ns()).why == "driving"
        assert driving == (for_s < 10.0)


@pytest.mark.cases(1)
@pytest.mark.parametrize("with_stamps", [True, False])
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_after_a_suspend_nothing_of_before_moves_anything(
    tmp_path: Path, with_stamps: bool, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()

        def command(vx: float, ago_s: float = 0.0) -> None:
            # The sender's clock went on while ours stood.
            ago_s -= bench.clock.slept_ns / S
            bench.payload(stamped(bench, vx, ago_s) if with_stamps else b'{"vx": %g}' % vx)

        for _ in range(40):
            command(0.3)
            await asyncio.sleep(0.05)
        assert min(bench.rim_speeds) > 0.25
        bench.clock.slept_ns += 4 * S
        awake_ns = bench.clock.now_ns()
        for n in range(4):
            command(0.5, 4.0 - n)
        await asyncio.sleep(1.0)
        assert bench.events("paused")
        (at_ns, order), *_ = bench.orders_since(awake_ns)
        assert is_stop(order)
        assert at_ns - awake_ns <= 20 * MS
        assert all(is_stop(order) for _, order in bench.orders_since(awake_ns))
        # Retransmitted commands come late; after that time again none does.
        await asyncio.sleep(2.0)
        command(0.5, 3.5)
        assert bench.arbiter.current(bench.clock.now_ns()).twist.is_zero
        await asyncio.sleep(1.5)
        for _ in range(40):
            command(0.3)
            await asyncio.sleep(0.05)
        assert min(bench.rim_speeds) > 0.2


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", STREAMS)
@on_virtual_time
async def test_an_estop_is_not_released_at_the_end_of_a_pause_before_commands_are_heard(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        bench.operator.engage_estop("a test")
        await bench.drive(1.0, 0.3)
        freeze(5.0)
        released, why = bench.operator.release_estop()
        assert not released
        assert "cmd_vel" in why


@pytest.mark.realtime
@pytest.mark.parametrize("dialect", ["polled", pytest.param("streamed", marks=pytest.mark.nightly)])
def test_a_real_process_that_was_stopped_says_so_obeys_no_old_command_and_drives_on(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], dialect: str
) -> None:
    robot = real_robot(simulate=["--dialect", dialect])
    app = client("client", robot.endpoint)
    app.in_state("standing")
    robot.daemon.process.send_signal(signal.SIGSTOP)
    # Few enough to be no backlog.
    for _ in range(3):
        app.session.put("cmd_vel", b'{"vx": 0.5}')
        time.sleep(0.5)
    robot.daemon.process.send_signal(signal.SIGCONT)
    wait_for(lambda: app.latest("status")["command"].get("after_pause") == 3, "three are refused")
    said = r"yahboomd did not run for ([\d.]+) s"
    # As long as it was stopped; a busy machine may have kept it waiting besides.
    wait_for(
        lambda: any(float(each) >= 1.4 for each in re.findall(said, robot.daemon.output)),
        "it says how long it did not run",
    )
    assert max(robot.settled_truth().travel_m) < 0.001
    app.drive(b'{"vx": 0.3}', 0.5)
    robot.daemon.process.send_signal(signal.SIGSTOP)
    app.drive(b'{"vx": 0.3}', 1.0)
    robot.daemon.process.send_signal(signal.SIGCONT)
    since = len(app.samples["status"])
    app.drive_until(
        b'{"vx": 0.3}',
        lambda: any(each["state"] == "driving" for each in app.samples["status"][since + 1 :]),
        "it drives on",
    )
    kinds = [event["kind"] for event in app.samples["events"]]
    assert "paused" in kinds
    assert not ALARMS & set(kinds)
