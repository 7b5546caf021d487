"""Wheels that do not turn: the vendors' speed loops wind up as the page says.

And the simulated motors stick as the ones of the firmwares' rigs do.
"""

from __future__ import annotations

import asyncio
import struct

import pytest
from board_bench import LinkBench
from rosmaster_firmware import firmware_instead_of_simulated
from vendor_firmware import instead_of_simulated, missing, rosmaster, rosmaster_missing

from yahboomd.core.protocol.rosmaster.packets import frame
from yahboomd.simulation.four_channel.flash import FlashContent, tuning
from yahboomd.simulation.motors import FAULTS, PWM_MAX, MotorLaw, MotorState
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.speed_loop import LoopSettings, wind_up_s
from yahboomd.simulation.virtual_time import on_virtual_time

IMAGE = pytest.mark.skipif(bool(missing()), reason=missing())
ROSMASTER = pytest.mark.skipif(bool(rosmaster_missing()), reason=rosmaster_missing())

SOLD, TUNED = (0.8, 0.06, 0.5), (0.3, 0.15, 0.0)


async def wound_up_s(board: LinkBench, command: bytes, output: int) -> float:
    """The time from a command until all outputs of wheels that are held have a value."""
    port = await board.open()
    board.robot.set_faults("all", FAULTS["stalled"], now_ns=board.clock.now_ns())
    await asyncio.sleep(0.5)
    port.write(command)
    motors = board.robot.plant.motors
    for ms in range(20_000):
        await asyncio.sleep(0.001)
        board.robot.advance(board.clock.now_ns())
        if min(abs(each.pwm) for each in motors) >= output:
            port.close()
            return ms / 1000.0
    raise AssertionError([each.pwm for each in motors])


@IMAGE
@pytest.mark.parametrize(
    ("speed", "dead_zone", "gains"),
    [
        *((speed, 1600, SOLD) for speed in (50, 100, -150, 300, 1000)),
        *((speed, 1900, SOLD) for speed in (100, 500)),
        *((speed, 1600, TUNED) for speed in (50, 300)),
    ],
)
@on_virtual_time
async def test_the_image_winds_up_as_the_formula_says(
    speed: int, dead_zone: int, gains: tuple[float, float, float]
) -> None:
    p, i, d = gains
    flash = FlashContent(dead_zone=dead_zone, p=p, i=i, d=d)
    law = tuning(flash, 1)
    for output in (2400, PWM_MAX):
        with instead_of_simulated():
            board = LinkBench(flash=flash)
            seconds = await wound_up_s(board, b"$spd:%d,0,%d,0#" % (speed, speed), output)
        # A command acts within two interrupts.
        assert 0.0 <= seconds - wind_up_s(speed, law, output) + 0.01 < 0.03


CARS = {"x3": (1, SOLD), "x3, tuned": (1, TUNED), "sunrise": (6, (1.5, 0.08, 0.5))}


@ROSMASTER
@pytest.mark.parametrize("car", CARS)
@pytest.mark.parametrize("speed", [50, 100, -150, 300, 1000])
@on_virtual_time
async def test_the_rosmaster_firmware_winds_up_as_the_formula_says(car: str, speed: int) -> None:
    car_type, (p, i, d) = CARS[car]
    dead_zone = 2000 if car == "sunrise" else 1600
    law = LoopSettings(
        mm_s_per_tick=1.0, p=p, i=i, d=d, dead_zone=dead_zone, most_output=PWM_MAX - dead_zone
    )
    volts = 7.6 if car == "sunrise" else 11.4
    for output in (2400, PWM_MAX):
        with firmware_instead_of_simulated():
            board = LinkBench(
                dialect="rosmaster",
                drive="mecanum",
                flash=RosmasterStored(car_type=car_type, p=p, i=i, d=d),
                battery_volts=volts,
                rated_volts=volts,
            )
            motion = frame(0x12, car_type, *struct.pack("<3h", speed, 0, 0))
            seconds = await wound_up_s(board, motion, output)
        assert 0.0 <= seconds - wind_up_s(speed, law, output) + 0.01 < 0.03


@ROSMASTER
@pytest.mark.parametrize(("wz", "volts"), [(300, 10.5), (500, 10.5), (500, 12.0)])
def test_a_motor_of_the_rosmaster_rig_breaks_away_when_the_simulated_one_does(
    monkeypatch: pytest.MonkeyPatch, wz: int, volts: float
) -> None:
    moving, stick = (0.42, 0.43, 0.39, 0.40), 1.2
    monkeypatch.setenv("FLOOR_FRICTION", ",".join(map(str, (*moving, stick))))
    board = rosmaster(1, 1)
    board.lib.fw_set(1, volts)
    motors = [
        MotorState(
            MotorLaw(
                max_speed_m_s=1.15,
                dead_zone=round(share * PWM_MAX),
                time_constant_s=0.06,
                ticks_per_metre=6464.0,
                stick=stick,
            )
        )
        for share in moving
    ]
    for motor in motors:
        motor.supply = volts / 12.0
    for _ in range(200):
        board.ms()
    board.put(frame(0x12, 1, *struct.pack("<3h", 0, 0, wz)))
    law = LoopSettings(mm_s_per_tick=1.0, p=0.8, i=0.06, d=0.5, dead_zone=1600, most_output=2000)
    speed_mm_s = wz * 0.164555
    due_ms = [
        wind_up_s(speed_mm_s, law, round(share * stick * 12.0 / volts * 3600)) * 1000
        for share in moving
    ]
    theirs_ms, ours_ms = [0] * 4, [0] * 4
    for ms in range(1, 6000):
        for index, motor in enumerate(motors):
            motor.pwm = round(board.tr.duty[index] * PWM_MAX)
            motor.advance(0.001)
            ours_ms[index] = ours_ms[index] or ms * (motor.speed_m_s != 0.0)
        board.ms()
        for index, speed_m_s in enumerate(board.tr.wheel):
            theirs_ms[index] = theirs_ms[index] or ms * (speed_m_s != 0.0)
    assert theirs_ms == pytest.approx(due_ms, abs=25.0)
    assert ours_ms == pytest.approx(theirs_ms, abs=11.0)
    for index, motor in enumerate(motors):
        assert motor.travel_m == pytest.approx(board.tr.ang[index] * 0.0325, rel=0.02)
