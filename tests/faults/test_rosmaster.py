"""What only a Rosmaster board does: a long start, a frame that is kept, an alarm, car types."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fault_bench import MS, ROSMASTER, FaultBench, is_stop
from robot_bench import state_and_why

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import on_virtual_time

FULL_VOLTS = {"battery_volts": 11.1, "rated_volts": 11.1}


def robot(tmp_path: Path, *overrides: str, **simulation: object) -> FaultBench:
    options = SimulationOptions(dialect="rosmaster", **simulation)  # type: ignore[arg-type]
    return FaultBench(tmp_path, overrides, options)


def written(bench: FaultBench) -> bytes:
    return b"".join(data for port in bench.ports for _, data in port.written)


@on_virtual_time
async def test_auto_finds_it_by_its_reports_and_nothing_but_stops_goes_before(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path) as bench:
        await bench.ready()
        session = bench.supervisor.session
        assert session is not None
        assert session.board is not None
        assert session.board.identity.dialect == ROSMASTER
        settings = session.board.identity.settings
        assert settings == {"version": "3.5", "car_type": 1, "pid": (3.2, 0.24, 2.0)}
        said = written(bench)
        assert b"$read" not in said
        # Its reports come by themselves: it is asked to switch nothing on but when it is armed.
        assert said.count(ROSMASTER.arm[0]) == 1


@on_virtual_time
async def test_connecting_and_driving_write_nothing_to_its_flash_nor_switching_its_reports_on(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path, flash=RosmasterStored(car_type=4, auto_report=0)) as bench:
        stored = msgspec.structs.replace(bench.robot.board.flash)  # type: ignore[attr-defined]
        await bench.ready()
        await bench.drive(1.0, 0.3, 0.5)
        assert min(bench.rim_speeds) > 0.1
        assert bench.robot.board.flash == stored  # type: ignore[attr-defined]


@on_virtual_time
async def test_a_car_type_that_is_not_known_gets_no_speed_and_is_named(tmp_path: Path) -> None:
    async with robot(tmp_path) as bench:
        bench.robot.board._drive.car_type = 9  # type: ignore[attr-defined]
        await bench.until(lambda: bench.events("board_unfit"))
        await bench.drive(1.0, 0.3)
        assert bench.standing
        assert all(is_stop(order) for _, order in bench.orders)
        assert "car type 9" in state_and_why(bench.controller)[1]


@pytest.mark.cases(1)
@pytest.mark.parametrize(("car_type", "wheel_m"), [(1, 0.0325), (2, 0.04), (6, 0.0325), (10, 0.04)])
@on_virtual_time
async def test_mecanum_wheels_keep_the_direction_though_one_of_them_would_be_too_fast(
    tmp_path: Path, car_type: int, wheel_m: float
) -> None:
    overrides = ["chassis.preset=mecanum", "chassis.wheel_base_m=0.16"]
    overrides += [f"chassis.wheel_radius_m={wheel_m}", "odometry.max_wheel_speed_m_s=3"]
    bench = robot(
        tmp_path,
        *overrides,
        drive="mecanum",
        wheel_base_m=0.16,
        wheel_radius_m=wheel_m,
        max_speed_m_s=2.0,
        flash=RosmasterStored(car_type=car_type),
    )
    async with bench:
        await bench.ready()
        # The board alone would clamp two of the wheels and bend the way.
        for _ in range(40):
            bench.payload(b'{"vx": 0.9, "vy": 0.45}')
            await asyncio.sleep(0.05)
        truth = bench.robot.truth(bench.clock.now_ns())
        assert truth.vy / truth.vx == pytest.approx(0.5, abs=0.03)
        assert bench.controller.counters["desaturated"] > 0
        assert abs(truth.theta) < 0.05
        pose = bench.heard.estimates[-1].pose
        assert math.hypot(pose.x - truth.x, pose.y - truth.y) < 0.06


R2 = {
    "drive": "ackermann",
    "lines": 11,
    "ratio": 19.0,
    "wheel_radius_m": 0.03425,
    "wheel_separation_m": 0.1911,
    "wheel_base_m": 0.23537,
}
R2_OVERRIDES = (
    "board.profile=r2",
    *("chassis.preset=ackermann", "chassis.wheel_base_m=0.23537"),
    "chassis.wheel_separation_m=0.1911",
)


@pytest.mark.cases(1)
@pytest.mark.parametrize("turn", [0.4, -0.9])
@on_virtual_time
async def test_a_car_that_steers_drives_its_curve_forward_and_back(
    tmp_path: Path, turn: float
) -> None:
    bench = robot(tmp_path, *R2_OVERRIDES, **R2)
    async with bench:
        await bench.ready()
        for vx in (0.5, -0.5):
            await bench.drive(2.0, vx, turn)
            truth = bench.robot.truth(bench.clock.now_ns())
            # The board takes whole degrees, and those of its own axles.
            assert truth.wz == pytest.approx(turn, abs=0.06)
            assert truth.vx == pytest.approx(vx, abs=0.02)
            board: Any = bench.robot.board
            assert board.steering_deg == round(math.degrees(math.atan(turn / vx * 0.23537)))
        pose = bench.heard.estimates[-1].pose
        # The rear wheels slip while the servo is on its way.
        assert math.hypot(pose.x - truth.x, pose.y - truth.y) < 0.06
        assert bench.controller.state()[0] == "driving"


# Starting.


@pytest.mark.cases(1)
@pytest.mark.parametrize("announced", [True, False])
@on_virtual_time
async def test_after_a_reset_it_stands_for_the_ten_seconds_of_its_start_and_drives_then(
    tmp_path: Path, announced: bool
) -> None:
    # Not the length that the bench would replace by a short one.
    async with robot(tmp_path, start_up_s=10.6) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        if not announced:
            bench.do("mute 0.5")
        bench.do("reset")
        reset_ns = bench.clock.now_ns()
        await bench.drive(10.5, 0.3)
        moving = [at for at, order in bench.orders_since(reset_ns) if not is_stop(order)]
        # Seen by the banner at once, else by the counts that stay away.
        assert all(at - reset_ns < (150 if announced else 350) * MS for at in moving)
        assert bench.fastest_since(reset_ns + 1500 * MS) < 0.01
        assert "12 s" in state_and_why(bench.controller)[1]
        await bench.drive(5.0, 0.3)
        assert min(bench.rim_speeds) > 0.25
        assert bench.events("odometry_discontinuity")


@pytest.mark.cases(1)
@pytest.mark.parametrize("late_s", [0.0, 0.2, 0.4, 0.7, 1.0, 1.3, 1.7, 2.1])
@on_virtual_time
async def test_a_motion_that_it_kept_over_its_start_is_stopped_as_soon_as_it_reports(
    tmp_path: Path, late_s: float
) -> None:
    async with robot(tmp_path, start_up_s=4.0 + late_s) as bench:
        await bench.ready()
        board: Any = bench.robot.board

        def motion_received(now_ns: int) -> None:
            for byte in bytes(20) + ROSMASTER.speeds((500, 0, 0)):
                board.receive(byte, now_ns)

        bench.do("reset")
        began_ns = bench.clock.now_ns()
        # As if the board had lost every stop that came before.
        begins_ns, regulated = board._begins_ns, []
        bench.robot.after(begins_ns - MS, motion_received)
        bench.robot.after(begins_ns + 3 * MS, lambda _: regulated.append(board._control.regulates))
        await asyncio.sleep(9.0)
        moved = [each for each in bench.truth if max(map(abs, each.speed_m_s)) >= 0.03]
        stood_ns = bench.stood_at(began_ns)
        first_ns = min((each.t_ns for each in moved), default=stood_ns)
        print(f"{late_s}: it moved for {(stood_ns - first_ns) / MS:.0f} ms")
        assert regulated == [True]
        assert stood_ns - first_ns < 500 * MS
        assert bench.standing


@on_virtual_time
async def test_a_board_that_is_switched_on_while_it_is_looked_for_is_not_said_to_have_no_battery(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path, start_up_s=10.6) as bench:
        await bench.ready()
        bench.do("reset")
        await asyncio.sleep(4.0)
        said = set()
        for step in range(80):
            if step % 19 == 0:
                bench.do("reset")
            await asyncio.sleep(0.1)
            said.add(state_and_why(bench.controller)[1])
        assert any("switched on or reset this moment" in why for why in said)
        assert not any("battery" in why for why in said)


# The battery.


@pytest.mark.cases(1)
@pytest.mark.parametrize("volts", [9.2, 13.6])
@on_virtual_time
async def test_a_battery_alarm_that_latched_is_named_with_the_voltage_once_and_not_connected_to(
    tmp_path: Path, volts: float
) -> None:
    async with robot(tmp_path, **FULL_VOLTS) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        bench.robot.plant.battery_volts = volts
        await bench.drive(10.0, 0.3)
        assert bench.standing
        state, why = state_and_why(bench.controller)
        assert state == "waiting"
        # Its supply sagged while it drove.
        assert any(f"had {volts - sag / 10.0:.1f} V at the alarm" in why for sag in range(5))
        assert "switch the board off and on" in why
        connected = len(bench.events("connected"))
        await bench.drive(20.0, 0.3)
        assert len(bench.events("connected")) == connected == 1
        assert len(bench.events("disconnected")) == 1
        # Voltage alone does not end it; a reset does.
        bench.robot.plant.battery_volts = 11.1
        await bench.drive(3.0, 0.3)
        assert bench.standing
        bench.do("reset")
        await bench.drive(8.0, 0.3)
        assert min(bench.rim_speeds) > 0.25


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("volts", "words"),
    [
        (8.85, "Use the car's own battery, then switch"),
        (6.25, "Charge or replace the battery, then"),
    ],
)
@on_virtual_time
async def test_a_sunrise_has_its_own_limits_in_the_words_of_its_silence(
    tmp_path: Path, volts: float, words: str
) -> None:
    flash = RosmasterStored(car_type=6)
    async with robot(tmp_path, "board.profile=sunrise", flash=flash) as bench:
        await bench.ready()
        bench.robot.plant.battery_volts = volts
        await bench.drive(10.0, 0.0)
        state, why = state_and_why(bench.controller)
        assert state == "waiting"
        assert (
            f"had {volts - 0.05:.1f} V at the alarm. Below 6.5 V or above 8.5 V for 2 s, it brakes"
            in why
        )
        assert f"voltage becomes. {words}" in why


@pytest.mark.nightly
@on_virtual_time
async def test_the_voltage_comes_once_in_a_period_though_it_is_reported_all_the_time(
    tmp_path: Path,
) -> None:
    async with robot(tmp_path, "board.battery_period_s=2", **FULL_VOLTS) as bench:
        await bench.ready()
        await asyncio.sleep(20.0)
        assert 9 <= len(bench.heard.volts) <= 12
        assert bench.heard.volts[-1] == pytest.approx(11.1, abs=0.11)
    async with robot(tmp_path, "board.battery_period_s=0", **FULL_VOLTS) as bench:
        await bench.ready()
        await asyncio.sleep(5.0)
        assert bench.heard.volts == []


@pytest.mark.cases(1)
@pytest.mark.parametrize("fault", ["mute 0.35", "mute 0.5", "hold 0.5"])
@on_virtual_time
async def test_a_gap_that_is_shorter_than_its_start_is_no_reset(tmp_path: Path, fault: str) -> None:
    async with robot(tmp_path, start_up_s=10.6) as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3)
        # The counters come nearer to zero, as after a reset.
        await bench.drive(1.0, -0.3)
        for _ in range(3):
            bench.do(fault)
            await bench.drive(0.6, -0.3)
        await bench.drive(1.0, -0.3)
        assert "board_reset" not in bench.heard.kinds
