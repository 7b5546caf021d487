from __future__ import annotations

import struct
from random import Random

import pytest

from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.board_sensor import ATTITUDE, RAW_ICM, RAW_MPU, BoardSensor

S = 1_000_000_000


def turning(name: str) -> tuple[Plant, BoardSensor]:
    plant = Plant(SimulationOptions(), Random(1))
    plant.start(0)
    sensor = BoardSensor(name, plant, Random(1))
    sensor.begin(0)
    plant.set_outputs((-2600, 0, 2600, 0))
    return plant, sensor


@pytest.mark.parametrize(
    ("name", "kind", "gyro", "force"),
    # An ICM20948 shows gravity against its z, as in captures.
    [("mpu9250", RAW_MPU, 3754.9, 16384.0), ("icm20948", RAW_ICM, -1000.0, -9806.65)],
)
def test_it_reports_its_kind_in_its_units_less_the_gyros_first_reading(
    name: str, kind: int, gyro: float, force: float
) -> None:
    plant, sensor = turning(name)
    found = sensor.report(RAW_MPU, S)
    assert found is not None
    assert found[0] == kind
    values = struct.unpack("<9h", found[1])
    truth = plant.chassis.twist([motor.speed_m_s for motor in plant.motors])
    assert truth.wz > 1.0
    assert values[2] / gyro == pytest.approx(truth.wz, rel=0.05)
    assert values[5] == pytest.approx(force, rel=0.12)


def test_the_attitude_begins_at_zero_with_each_start() -> None:
    plant, sensor = turning("mpu9250")
    kind, payload = sensor.report(ATTITUDE, S // 2)
    assert kind == ATTITUDE
    assert struct.unpack("<3h", payload)[2] == pytest.approx(plant.chassis.pose.theta * 1e4, abs=1)
    sensor.begin(S)
    assert sensor.report(ATTITUDE, S) == (ATTITUDE, bytes(6))


def test_without_a_sensor_it_reports_nothing() -> None:
    _, sensor = turning("")
    assert sensor.report(RAW_MPU, S) is None
    assert sensor.report(ATTITUDE, S) is None
