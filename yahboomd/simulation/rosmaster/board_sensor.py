"""The inertial sensor of the Rosmaster board, in the units of its reports."""

from __future__ import annotations

import math
import struct
from random import Random

from yahboomd.simulation.imu import GRAVITY_M_S2, SENSORS, ImuModel, RawImu
from yahboomd.simulation.plant import Plant
from yahboomd.simulation.rosmaster.rosmaster_flash import short

SCALES_MPU = (3754.9, 16384.0 / GRAVITY_M_S2, 1.0 / 0.15e-6)
SCALES_ICM = (1000.0, 1000.0, 1e9)
"""Counts of the registers for 1 rad/s, 1 m/s^2 and 1 T."""

RAW_MPU, ATTITUDE, RAW_ICM = 0x0B, 0x0C, 0x0E


class BoardSensor:
    """A sensor of one kind, or none.

    Args:
        name: ``mpu9250``, ``icm20948``, or empty.
    """

    def __init__(self, name: str, plant: Plant, random: Random) -> None:
        sensor = SENSORS.get(name)
        self._model = None if sensor is None else ImuModel(sensor, random)
        self._is_mpu = name == "mpu9250"
        self._plant = plant
        self._gyro_zero: tuple[float, ...] = (0.0, 0.0, 0.0)
        self._heading_zero = 0.0

    def begin(self, now_ns: int) -> None:
        """Take one reading for the gyro's zero, wherever it moves; the heading begins at 0."""
        self._plant.advance(now_ns)
        self._heading_zero = self._plant.chassis.pose.theta
        if self._model is not None:
            self._gyro_zero = self._measured(self._model, now_ns).gyro_rad_s

    def report(self, kind: int, now_ns: int) -> tuple[int, bytes] | None:
        """The function and the payload of a report; None without a sensor.

        Args:
            kind: :data:`ATTITUDE`; any other for the raw values.
        """
        if self._model is None:
            return None
        if kind == ATTITUDE:
            self._plant.advance(now_ns)
            turned_by = self._plant.chassis.pose.theta - self._heading_zero
            theta = math.remainder(turned_by, math.tau)
            return kind, struct.pack("<3h", 0, 0, short(theta * 1e4))
        gyro, force, field = self._measured(self._model, now_ns)
        turned = tuple(value - zero for value, zero in zip(gyro, self._gyro_zero, strict=True))
        scales = SCALES_MPU if self._is_mpu else SCALES_ICM
        values = [
            short(scale * value)
            for scale, vector in zip(scales, (turned, force, field), strict=True)
            for value in vector
        ]
        return RAW_MPU if self._is_mpu else RAW_ICM, struct.pack("<9h", *values)

    def _measured(self, model: ImuModel, now_ns: int) -> RawImu:
        plant = self._plant
        plant.advance(now_ns)
        twist = plant.chassis.twist([motor.speed_m_s for motor in plant.motors])
        return model.sample(now_ns, twist, plant.chassis.pose.theta)
