"""The control path with a simulated robot, on virtual time."""

from __future__ import annotations

import asyncio
import itertools
import math
from pathlib import Path

import pytest
from real_robot import wait_for
from robot_bench import RobotBench, steps_of

from yahboomd.core.drive import battery
from yahboomd.core.drive.standing import why
from yahboomd.core.model import NS_PER_S, Cause, EncoderReading
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

DIALECTS = ["streamed", "polled"]


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> RobotBench:
    return RobotBench(tmp_path, overrides, SimulationOptions(**simulation))  # type: ignore[arg-type]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_command_turns_the_wheels_and_silence_stops_them(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.03)
        assert bench.controller.state() == ("driving", (Cause("driving", "cmd_vel drives."),))
        await asyncio.sleep(1.2)
        assert bench.standing
        state, reasons = bench.controller.state()
        assert state == "standing"
        assert "cmd_vel fell silent" in why(reasons)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_the_pose_follows_the_ground_truth(tmp_path: Path, dialect: str) -> None:
    simulation = {"dialect": dialect, "wheel_separation_m": 0.15}
    async with robot(tmp_path, **simulation) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3, 0.6)
        await bench.drive(2.0, 0.2, -0.9)
        await asyncio.sleep(1.5)
        estimate = bench.heard.estimates[-1]
        truth = bench.robot.plant.chassis.pose
        assert math.hypot(estimate.pose.x - truth.x, estimate.pose.y - truth.y) < 0.008
        assert abs(estimate.pose.theta - truth.theta) < 2 * 0.00016 / 0.15
        assert math.hypot(truth.x, truth.y) > 0.5


@on_virtual_time
async def test_a_new_command_is_on_the_wire_at_once_when_the_line_is_free(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        assert bench.port is not None
        while bench.clock.now_ns() - bench.port.written[-1][0] < 20_000_000:
            await asyncio.sleep(0.005)
        before = len(bench.port.written)
        now_ns = bench.clock.now_ns()
        bench.command(0.3)
        # Not at the next control step: now.
        assert len(bench.port.written) == before + 1
        assert bench.port.written[-1][0] == now_ns


@on_virtual_time
async def test_nothing_moves_before_the_first_counts(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        bench.command(0.3)
        state, reasons = bench.controller.state()
        assert state == "waiting"
        assert "No board yet." in why(reasons)
        await bench.ready()
        await asyncio.sleep(0.1)
        # Commands from the time without a board are over.
        assert bench.standing


@on_virtual_time
async def test_the_estop_stops_at_once_and_holds_against_commands_and_over_a_restart(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        await asyncio.sleep(0.03)
        bench.operator.engage_estop("a test")
        await bench.drive(1.0, 0.3)
        assert bench.standing
        state, reasons = bench.controller.state()
        assert state == "estopped"
        assert "engaged by a test" in why(reasons)
        # Another thread writes it, on the machine's time.
        wait_for((tmp_path / "estop").exists, "the latch is on file")
    async with robot(tmp_path) as again:
        await again.until(lambda: again.controller.state()[0] == "estopped")


@on_virtual_time
async def test_the_pose_goes_on_after_an_unplug_and_counts_what_was_travelled(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        # Far enough that the counters cannot have come from zero unobserved.
        await bench.drive(8.0, 0.3)
        bench.robot.unplug(bench.clock.now_ns(), 0.5)
        await bench.until(lambda: bench.controller.state()[0] == "waiting")
        await bench.ready()
        await asyncio.sleep(1.5)
        assert bench.standing
        truth = bench.robot.plant.chassis.pose
        assert bench.heard.estimates[-1].pose.x == pytest.approx(truth.x, abs=0.002)
        assert truth.x > 2.4


@pytest.mark.cases(1)
@on_virtual_time
@pytest.mark.parametrize("dialect", ["streamed", "polled"])
async def test_the_way_to_standstill_is_in_the_pose_when_the_service_ends(
    tmp_path: Path, dialect: str
) -> None:
    async with robot(tmp_path, dialect=dialect) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.4)
        bench.tasks[0].cancel()
        await asyncio.sleep(1.0)
        assert bench.standing
        truth = bench.robot.plant.chassis.pose
        assert bench.heard.estimates[-1].pose.x == pytest.approx(truth.x, abs=0.004)
        assert "odometry_discontinuity" not in bench.heard.kinds


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "malformed"),
        (b"garbage", "unknown_encoding"),
        (b'{"vx": NaN}', "not_finite"),
        (b'{"vx": 1e999}', "not_finite"),
        (b'{"hello": 1}', "no_velocity"),
        (b'{"vx": "fast"}', "wrong_type"),
        (b"{" + b" " * 5000 + b"}", "oversize"),
    ],
)
@on_virtual_time
async def test_a_bad_command_is_refused_counted_and_explained(
    tmp_path: Path, payload: bytes, reason: str
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        bench.payload(payload)
        await asyncio.sleep(0.2)
        assert bench.standing
        facts = bench.intake.status_values()
        assert facts["refused"] == 1
        assert facts[reason] == 1
        assert reason in str(facts["last_refusal"])
        # It explains, too, why the robot stands.
        assert bench.arbiter.recent_refusals(bench.clock.now_ns()) == {reason: 1}


@on_virtual_time
async def test_a_flood_of_commands_runs_a_bounded_number_of_steps(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        steps = steps_of(bench.controller)
        for number in range(5_000):
            bench.command(0.3 + (number % 2) * 0.01)
            if number % 20 == 0:
                await asyncio.sleep(0.001)
        # 50 a second by schedule, 500 a second for commands.
        assert len(steps) < 150


@on_virtual_time
async def test_at_rest_few_steps_are_left_until_a_command_comes(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(0.5, 0.3)
        await asyncio.sleep(3.0)
        steps = steps_of(bench.controller)
        await asyncio.sleep(2.0)
        assert 18 <= len(steps) <= 25
        before, now_ns = len(steps), bench.clock.now_ns()
        await bench.drive(1.0, 0.3)
        assert steps[before] == now_ns
        # Fifty a second by the clock again, and twenty for commands.
        assert len(steps) - before >= 50


@pytest.mark.parametrize("dialect", ["polled", "streamed"])
@on_virtual_time
async def test_steps_keep_their_period_while_wheels_turn_and_ride_on_counts_at_rest(
    tmp_path: Path, dialect: str
) -> None:
    async with RobotBench(tmp_path, (), SimulationOptions(dialect=dialect)) as bench:
        await bench.ready()
        bench.command(0.3)
        await asyncio.sleep(0.05)
        steps, counted = steps_of(bench.controller), list[int]()
        begun_ns = bench.clock.now_ns()
        hear = bench.controller.reading

        def heard(reading: EncoderReading) -> None:
            counted.append(bench.clock.now_ns())
            hear(reading)

        bench.supervisor.session.board._poller._on_reading = heard
        await asyncio.sleep(0.41)
        assert {round((b - a) / 1e6, 3) for a, b in itertools.pairwise(steps)} == {20.0}
        assert steps[0] - begun_ns <= 20_000_000
        assert bench.clock.now_ns() - steps[-1] <= 20_000_000
        await asyncio.sleep(3.0)
        steps.clear()
        await asyncio.sleep(1.0)
        assert 9 <= len(steps) <= 13
        assert set(steps) <= set(counted)
        bench.robot.mute(bench.clock.now_ns(), 0.3)
        steps.clear()
        await asyncio.sleep(0.3)
        assert len(steps) >= 2


@on_virtual_time
async def test_the_first_step_of_a_ramp_after_a_rest_is_no_longer_than_a_period(
    tmp_path: Path,
) -> None:
    limits = "limits.linear={velocity=0.8, acceleration=1.0, deceleration=2.0}"
    async with robot(tmp_path, limits) as bench:
        await bench.ready()
        steps = steps_of(bench.controller)
        await asyncio.sleep(3.0)
        while bench.clock.now_ns() - steps[-1] < 75_000_000:
            await asyncio.sleep(0.001)
        bench.command(0.5)
        assert 0.0 < max(bench.controller._wheels.command_m_s) <= 0.02


@on_virtual_time
async def test_when_the_last_client_leaves_the_wheels_stop_at_once(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.controller.bus_lost()
        assert bench.heard.commands is not None
        await asyncio.sleep(0.4)
        assert bench.standing
        lost = "drove and was lost 0.4 s ago: its client left the bus."
        assert why(bench.controller.state()[1]).endswith(lost)
        bench.controller.bus_lost()
        assert bench.controller.state()[1] == (Cause("no_command", "No source commands motion."),)


@on_virtual_time
async def test_wishes_that_cannot_be_met_are_counted_by_what_held_them_back(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path, "limits.linear.velocity=0.4") as bench:
        await bench.ready()
        await bench.drive(0.5, 0.4)
        assert bench.controller.status_values().get("limited", 0) == 0
        await bench.drive(0.5, 0.6)
        assert bench.controller.status_values()["limited"] >= 20
        assert bench.controller.status_values().get("desaturated", 0) == 0
        await bench.drive(0.5, 0.0, 60.0)
        assert bench.controller.status_values()["desaturated"] >= 20
        assert max(map(abs, bench.rim_speeds)) < 0.5


CAR = "chassis.kinematics=ackermann", "chassis.wheel_base_m=0.2", "chassis.steering_max_rad=0.7854"


@on_virtual_time
async def test_a_car_drives_its_tightest_curve_where_the_command_is_tighter(tmp_path: Path) -> None:
    async with robot(tmp_path, *CAR) as bench:
        await bench.ready()
        await bench.drive(1.5, 0.2, 0.8)
        assert bench.controller.status_values().get("too_tight", 0) == 0
        await bench.drive(1.5, 0.2, 3.0)
        left, right = bench.rim_speeds
        assert (left + right) / 2.0 == pytest.approx(0.2, abs=0.02)
        # Radius 0.2 m: 1 rad/s.
        assert (right - left) / 0.15 == pytest.approx(1.0, abs=0.1)
        assert bench.controller.status_values()["too_tight"] >= 60
        await asyncio.sleep(1.5)
        truth = bench.robot.truth(bench.clock.now_ns()).pose
        pose = bench.heard.estimates[-1].pose
        assert (pose.x, pose.y, pose.theta) == pytest.approx(
            (truth.x, truth.y, truth.theta), abs=0.01
        )
        assert truth.theta > 2.0


@on_virtual_time
async def test_a_board_that_reports_too_few_volts_is_corrected(tmp_path: Path) -> None:
    options = ["board.battery_period_s=0.5", "board.battery_scale=1.04"]
    async with robot(tmp_path, *options, battery_volts=7.0, rated_volts=7.0) as bench:
        await bench.until(lambda: bench.heard.volts)
        assert bench.heard.volts[-1] == pytest.approx(7.28, abs=0.05)
        assert bench.controller.volts == bench.heard.volts[-1]


@on_virtual_time
async def test_an_empty_battery_ends_no_motion_and_refuses_the_next_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(battery, "REST_NS", 4 * NS_PER_S)
    limits = [f"board.battery_{key}" for key in ("low_v=7.0", "stop_v=6.5", "period_s=1.0")]
    async with robot(tmp_path, *limits) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.robot.plant.battery_volts = 6.0
        await bench.drive(6.0, 0.3)
        assert min(bench.rim_speeds) > 0.2
        assert "battery_empty" not in bench.heard.kinds
        await asyncio.sleep(8.0)
        assert bench.heard.kinds.count("battery_empty") == 1
        await bench.drive(1.0, 0.3)
        assert bench.standing
        assert "battery_empty" in bench.intake.last_refusal
        assert " V at rest, less than board.battery_stop_v = 6.5" in why(
            bench.controller.state()[1]
        )
        for source in ("cmd_vel/teleop", "cmd_vel/web"):
            await bench.drive(2.0, 0.3, source=source)
            assert bench.rim_speeds == pytest.approx([0.1] * 2, abs=0.02)
            await asyncio.sleep(1.5)
        # A new one: programs drive again.
        bench.robot.plant.battery_volts = 8.4
        await asyncio.sleep(10.0)
        assert bench.heard.kinds[-1] == "battery_good"
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) > 0.2
