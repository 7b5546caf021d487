"""The inertial sensor of a simulated robot: its measurements, and its errors.

The law, for each axis of the gyro and of the accelerometer:
``measured = scale * truth + zero + drift * (temperature - 25) + noise``, cut off at the sensor's
limits and turned into its own axes. The temperature rises like that of a board that was switched on
at time zero. Each sensor's own zeros, scales and drifts are drawn uniformly from the tolerances of
its datasheet.
"""

from __future__ import annotations

import math
from random import Random
from typing import NamedTuple

import msgspec

from yahboomd.core.model import Twist2d, Vector3

GRAVITY_M_S2 = 9.80665
FIELD_AHEAD_T, FIELD_UP_T = 20e-6, -44e-6
"""The Earth's field, of central Europe, at heading zero: north is ahead."""

_DEGREE = math.pi / 180.0
_MILLI_G = 1e-3 * GRAVITY_M_S2


class ImuOptions(msgspec.Struct, frozen=True, kw_only=True):
    """The tolerances of a sensor; zero for a perfect one. A tuple has one value for each axis.

    Attributes:
        gyro_density: Noise of the gyro, rad/s per square root of Hz.
        gyro_zero_rad_s: The largest zero error at rest, at 25 degrees.
        gyro_drift_rad_s_k: The largest change of that error per kelvin.
        gyro_scale: The largest error of its scale, as a share.
        gyro_limit_rad_s: The greatest rate that it shows.
        acceleration_density: Noise of the accelerometer, m/s^2 per square root of Hz.
        acceleration_zero_m_s2: The largest zero error.
        acceleration_drift_m_s2_k: The largest change of that error per kelvin.
        acceleration_scale: The largest error of its scale, as a share.
        acceleration_limit_m_s2: The greatest acceleration that it shows.
        magnetic_noise_t: Standard deviation of the magnetometer.
        bandwidth_hz: Of the filter in front of each sample: the noise of one sample is the density
            times the square root of this.
        temperature_c: At the start.
        warming_k: How much warmer it becomes.
        warming_s: The time constant of that.
        axes: The axes of the sensor that point forward, left and up, such as ``x -y -z``.
    """

    gyro_density: float = 0.0
    gyro_zero_rad_s: Vector3 = (0.0, 0.0, 0.0)
    gyro_drift_rad_s_k: Vector3 = (0.0, 0.0, 0.0)
    gyro_scale: float = 0.0
    gyro_limit_rad_s: float = math.inf
    acceleration_density: float = 0.0
    acceleration_zero_m_s2: Vector3 = (0.0, 0.0, 0.0)
    acceleration_drift_m_s2_k: Vector3 = (0.0, 0.0, 0.0)
    acceleration_scale: float = 0.0
    acceleration_limit_m_s2: float = math.inf
    magnetic_noise_t: float = 0.0
    bandwidth_hz: float = 20.0
    temperature_c: float = 25.0
    warming_k: float = 10.0
    warming_s: float = 300.0
    axes: str = "x y z"


MPU9250 = ImuOptions(
    gyro_density=0.01 * _DEGREE,
    gyro_zero_rad_s=(5.0 * _DEGREE,) * 3,
    # The datasheet has 30 degrees/s over 125 kelvin.
    gyro_drift_rad_s_k=(0.24 * _DEGREE,) * 3,
    gyro_scale=0.03,
    gyro_limit_rad_s=500.0 * _DEGREE,
    acceleration_density=0.3 * _MILLI_G,
    acceleration_zero_m_s2=(60.0 * _MILLI_G, 60.0 * _MILLI_G, 80.0 * _MILLI_G),
    acceleration_drift_m_s2_k=(1.5 * _MILLI_G,) * 3,
    acceleration_scale=0.03,
    acceleration_limit_m_s2=2.0 * GRAVITY_M_S2,
    magnetic_noise_t=0.3e-6,
    bandwidth_hz=20.0,
)
"""By its datasheet, as the board sets it up: 500 degrees/s, 2 g, a filter of 20 Hz."""

ICM20948 = ImuOptions(
    # As an owner measured it: 5.3 mrad/s, and 0.12 m/s^2 below. The data sheet has a third of one
    # and a seventh of the other.
    gyro_density=0.0425 * _DEGREE,
    gyro_zero_rad_s=(5.0 * _DEGREE,) * 3,
    gyro_drift_rad_s_k=(0.05 * _DEGREE,) * 3,
    gyro_scale=0.015,
    gyro_limit_rad_s=2000.0 * _DEGREE,
    acceleration_density=1.7 * _MILLI_G,
    acceleration_zero_m_s2=(50.0 * _MILLI_G,) * 3,
    acceleration_drift_m_s2_k=(0.8 * _MILLI_G,) * 3,
    acceleration_scale=0.03,
    acceleration_limit_m_s2=4.0 * GRAVITY_M_S2,
    magnetic_noise_t=0.3e-6,
    bandwidth_hz=51.0,
    # At rest its z is -9.87, in captures; that its gyro turns likewise is assumed.
    axes="x -y -z",
)
"""By its datasheet, but for noise and axes; its motion processor hands out samples at 102 Hz."""

SENSORS: dict[str, ImuOptions] = {"mpu9250": MPU9250, "icm20948": ICM20948}


class RawImu(NamedTuple):
    """The sensor's output, along its own axes, before the board rounds it to its units.

    Attributes:
        acceleration_m_s2: Specific force: at rest, gravity upward.
    """

    gyro_rad_s: Vector3
    acceleration_m_s2: Vector3
    magnetic_t: Vector3


class ImuModel:
    """A sensor in the middle between the wheels.

    Attributes:
        forced_gyro_rad_s: The gyro's output in place of its measurement, along its own axes; None
            while it works.
    """

    def __init__(self, options: ImuOptions, random: Random) -> None:
        self.options = options
        self._random = random
        root_hz = math.sqrt(options.bandwidth_hz)

        def channels(zero: Vector3, drift: Vector3, scale: float, noise: float) -> list[_Channel]:
            pairs = zip(zero, drift, strict=True)
            return [_Channel(*pair, scale, noise, random) for pair in pairs]

        self._gyro = channels(
            *(options.gyro_zero_rad_s, options.gyro_drift_rad_s_k),
            *(options.gyro_scale, options.gyro_density * root_hz),
        )
        self._acceleration = channels(
            *(options.acceleration_zero_m_s2, options.acceleration_drift_m_s2_k),
            *(options.acceleration_scale, options.acceleration_density * root_hz),
        )
        self._places = _places(options.axes)
        self._before: tuple[int, Twist2d] | None = None
        self.forced_gyro_rad_s: Vector3 | None = None

    def gyro_zero_rad_s(self, now_ns: int) -> Vector3:
        """The gyro's output at rest now, but for its noise, along the sensor's own axes."""
        warmer_k = self._warmer_k(now_ns)
        x, y, z = (channel.zero + channel.drift * warmer_k for channel in self._gyro)
        return x, y, z

    def sample(self, now_ns: int, twist: Twist2d, theta: float) -> RawImu:
        """Measure.

        Args:
            now_ns: Time since the sensor was switched on; grows from call to call. Accelerations
                are means since the call before.
            twist: The true velocity of the base.
            theta: Its true heading, radians.
        """
        options, warmer_k = self.options, self._warmer_k(now_ns)
        ahead = left = 0.0
        if self._before is not None and now_ns > self._before[0]:
            dt_s = (now_ns - self._before[0]) * 1e-9
            ahead = (twist.vx - self._before[1].vx) / dt_s
            left = (twist.vy - self._before[1].vy) / dt_s
        self._before = (now_ns, twist)
        force = (ahead - twist.wz * twist.vy, left + twist.wz * twist.vx, GRAVITY_M_S2)
        cos, sin = math.cos(theta), math.sin(theta)
        field = (FIELD_AHEAD_T * cos, -FIELD_AHEAD_T * sin, FIELD_UP_T)
        noise, gauss = options.magnetic_noise_t, self._random.gauss
        magnetic = self._turned(field)
        limit = options.gyro_limit_rad_s
        gyro = _measured(self._gyro, self._turned((0.0, 0.0, twist.wz)), warmer_k, limit)
        return RawImu(
            gyro_rad_s=self.forced_gyro_rad_s or gyro,
            acceleration_m_s2=_measured(
                self._acceleration, self._turned(force), warmer_k, options.acceleration_limit_m_s2
            ),
            magnetic_t=(
                magnetic[0] + noise * gauss(0.0, 1.0),
                magnetic[1] + noise * gauss(0.0, 1.0),
                magnetic[2] + noise * gauss(0.0, 1.0),
            ),
        )

    def _warmer_k(self, now_ns: int) -> float:
        options = self.options
        rise = options.warming_k * -math.expm1(-now_ns * 1e-9 / options.warming_s)
        return options.temperature_c - 25.0 + rise

    def _turned(self, body: Vector3) -> Vector3:
        """Components along the axes of the sensor, of a vector along those of the base."""
        turned = [0.0, 0.0, 0.0]
        for value, (axis, sign) in zip(body, self._places, strict=True):
            turned[axis] = sign * value
        return turned[0], turned[1], turned[2]


class _Channel:
    """One axis: its own errors, and its noise."""

    def __init__(
        self, zero: float, drift: float, scale: float, noise: float, random: Random
    ) -> None:
        self.zero = random.uniform(-zero, zero)
        self.drift = random.uniform(-drift, drift)
        self._scale = 1.0 + random.uniform(-scale, scale)
        self._noise = noise
        self._random = random

    def measured(self, truth: float, warmer_k: float, limit: float) -> float:
        value = self._scale * truth + self.zero + self.drift * warmer_k
        return max(-limit, min(limit, value + self._noise * self._random.gauss(0.0, 1.0)))


def _measured(channels: list[_Channel], truth: Vector3, warmer_k: float, limit: float) -> Vector3:
    x, y, z = (
        channel.measured(each, warmer_k, limit)
        for channel, each in zip(channels, truth, strict=True)
    )
    return x, y, z


def _places(axes: str) -> tuple[tuple[int, float], ...]:
    """For forward, left and up: the number of the sensor's axis, and its sign."""
    return tuple(
        ("xyz".index(word[-1]), -1.0 if word.startswith("-") else 1.0) for word in axes.split()
    )
