"""Measures the heading by wheels and gyro against the wheels alone: ``make heading``.

A base drives about for ten minutes: straight, in curves, on the spot, with stops. Motors lag by 60
ms, and sensors are read as a board of 41 ms does. Its gyro is the simulator's, with the noise, zero
and warming of a datasheet, calibrated to 0.1 % of scale, its samples up to 20 ms older than
yahboomd assumes. There are 100 runs, each with another sensor, floor and way. A skid-steer base
acts on each square metre of floor as if it were up to 20 % wider or narrower than configured. The
other base is differential, and does not slip.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from random import Random
from statistics import fmean
from typing import NamedTuple

import msgspec

from yahboomd.core.drive.kinematics import KINEMATICS
from yahboomd.core.model import EncoderReading, ImuReading, ImuSensor, Motor, Twist2d
from yahboomd.core.odometry.odometer import Odometer
from yahboomd.simulation.imu import SENSORS, ImuModel

TRACK_M, RADIUS_M, TICKS = 0.15, 0.0335, 1320
TICK_M = 2.0 * math.pi * RADIUS_M / TICKS
CYCLE_S, IMU_S, STEP_S = 0.041, 0.021, 0.0041
"""Counters are read every 41 ms, the gyro 21 ms after them, as by a Rosmaster board."""

LATE_NS = 20_000_000

SCALE = 0.001
"""The error of a gyro after ten turns by hand were compared with a mark on the floor."""

UNITS_RAD_S = {"mpu9250": 1.0 / 3754.9, "icm20948": 1e-3}
ACCELERATION_M_S2, ACCELERATION_RAD_S2, LAG_S = 2.5, 12.0, 0.06
LOOK_S = 10.0


class Look(NamedTuple):
    """A moment of a run: errors of the heading, and the variance that the filter gives its own."""

    wheels: float
    fused: float
    variance: float
    bias: float


class Way:
    """The commands of a base: it stands for five seconds, then wanders."""

    def __init__(self, random: Random) -> None:
        self._random = random
        self._until_s, self._twist = 5.0, (0.0, 0.0)
        self.vx = self.wz = 0.0
        self._vx = self._wz = 0.0

    def follow(self, now_s: float, dt_s: float) -> None:
        """Ramp and lag towards the command."""
        random = self._random
        if now_s >= self._until_s:
            kind = random.choice(("straight", "curve", "spin", "stop"))
            self._until_s = now_s + random.uniform(1.0, 4.0)
            vx = 0.0 if kind in {"spin", "stop"} else random.uniform(0.1, 0.5)
            wz = {"curve": random.uniform(-1.0, 1.0), "spin": random.choice((-1.5, -0.8, 0.8, 1.5))}
            self._twist = (vx, wz.get(kind, 0.0))
        vx, wz = self._twist
        self._vx += max(-ACCELERATION_M_S2 * dt_s, min(ACCELERATION_M_S2 * dt_s, vx - self._vx))
        most = ACCELERATION_RAD_S2 * dt_s
        self._wz += max(-most, min(most, wz - self._wz))
        share = dt_s / LAG_S
        self.vx += share * (self._vx - self.vx)
        self.wz += share * (self._wz - self.wz)
        if abs(self.vx) < 1e-3 and vx == 0.0:
            self.vx = 0.0
        if abs(self.wz) < 5e-3 and wz == 0.0:
            self.wz = 0.0


class Run:
    """One base, its sensors, its floor and its odometer."""

    def __init__(self, seed: int, sensor: str, geometry: str, scale: float) -> None:
        self._random = random = Random(seed)
        options = msgspec.structs.replace(SENSORS[sensor], gyro_scale=scale)
        self._imu = ImuModel(options, random)
        self._late_ns = random.randrange(LATE_NS)
        self._unit = UNITS_RAD_S[sensor]
        self._slips = geometry == "skid_steer"
        self._floor: dict[tuple[int, int], float] = {}
        self._way = Way(random)
        self._phases = random.random(), random.random()
        self.odometer = Odometer(
            KINEMATICS[geometry](separation_m=TRACK_M),
            tuple(
                Motor(
                    name=name,
                    wheel=wheel,
                    position=2 * wheel + 1,
                    radius_m=RADIUS_M,
                    ticks_per_revolution=TICKS,
                )
                for wheel, name in enumerate(("left", "right"))
            ),
            fused=True,
            gyro_scale=scale / math.sqrt(3.0),
        )
        self.odometer.set_sample_period(round(CYCLE_S * 1e9), each_line=True)
        self._sensor = ImuSensor(
            name=sensor,
            gyro_limit_rad_s=options.gyro_limit_rad_s,
            gyro_noise_rad_s=options.gyro_density * math.sqrt(options.bandwidth_hz),
            acceleration_limit_m_s2=options.acceleration_limit_m_s2,
            acceleration_noise_m_s2=0.02,
        )
        self.theta = self._x = self._y = self._left = self._right = 0.0

    def drive(self, seconds: float) -> list[Look]:
        """Drive for some seconds, and record the heading every ten seconds."""
        looks: list[Look] = []
        now_s = 0.0
        per_cycle, imu_at = round(CYCLE_S / STEP_S), round(IMU_S / STEP_S)
        for cycle in range(round(seconds / CYCLE_S)):
            for step in range(per_cycle):
                if step == imu_at:
                    self._measure(round(now_s * 1e9))
                now_s = cycle * CYCLE_S + (step + 1) * STEP_S
                self._move(now_s)
            now_ns = round(now_s * 1e9)
            self._count(now_ns)
            if now_s >= LOOK_S * (len(looks) + 1):
                looks.append(self._look(now_ns))
        return looks

    def _move(self, now_s: float) -> None:
        way = self._way
        way.follow(now_s, STEP_S)
        half = 0.5 * way.wz * TRACK_M
        self._left += (way.vx - half) * STEP_S
        self._right += (way.vx + half) * STEP_S
        self.theta += self._turning * STEP_S
        self._x += way.vx * math.cos(self.theta) * STEP_S
        self._y += way.vx * math.sin(self.theta) * STEP_S

    @property
    def _turning(self) -> float:
        if not self._slips:
            return self._way.wz
        place = math.floor(self._x), math.floor(self._y)
        if place not in self._floor:
            self._floor[place] = self._random.uniform(0.8, 1.2)
        return self._way.wz / self._floor[place]

    def _measure(self, now_ns: int) -> None:
        twist = Twist2d(vx=self._way.vx, wz=self._turning)
        shown = self._imu.sample(now_ns, twist, self.theta)
        x, y, z = (round(each / self._unit) * self._unit for each in shown.gyro_rad_s)
        self.odometer.accept(
            ImuReading(
                sensor=self._sensor,
                sent_ns=now_ns + self._late_ns,
                gyro_rad_s=(x, y, z),
                acceleration_m_s2=shown.acceleration_m_s2,
            )
        )

    def _count(self, now_ns: int) -> None:
        left, right = (
            math.floor(travel / TICK_M + phase)
            for travel, phase in zip((self._left, self._right), self._phases, strict=True)
        )
        self.odometer.update(
            EncoderReading(
                ticks=(left, 0, right, 0),
                received_ns=now_ns,
                sent_ns=now_ns,
                after_gap=now_ns < 50_000_000,
            )
        )

    def _look(self, now_ns: int) -> Look:
        estimate = self.odometer.estimate
        assert estimate is not None
        left, right = estimate.motor_ticks
        return Look(
            wheels=(right - left) * TICK_M / TRACK_M - self.theta,
            fused=estimate.pose.theta - self.theta,
            variance=estimate.pose_covariance[8],
            bias=self.odometer.gyro_bias_rad_s - self._imu.gyro_zero_rad_s(now_ns)[2],
        )


class Figures(NamedTuple):
    """Many runs in numbers: rad, and ratios of fused to wheels."""

    wheels: float
    fused: float
    ratio: float
    median: float
    p95: float
    nees: float
    nees_way: float
    bias: float


def one(seed: int, sensor: str, geometry: str, seconds: float, scale: float) -> list[Look]:
    """The looks of one run."""
    return Run(seed, sensor, geometry, scale).drive(seconds)


def figures(runs: list[list[Look]]) -> Figures:
    """The results of the runs: at their ends, and on the way."""
    ends = [looks[-1] for looks in runs]
    every = [look for looks in runs for look in looks]
    wheels, fused = _rms([e.wheels for e in ends]), _rms([e.fused for e in ends])

    def ratio(share: float) -> float:
        return _quantile([e.fused for e in every], share) / _quantile(
            [e.wheels for e in every], share
        )

    return Figures(
        wheels=wheels,
        fused=fused,
        ratio=fused / wheels,
        median=ratio(0.5),
        p95=ratio(0.95),
        nees=fmean(e.fused**2 / e.variance for e in ends),
        nees_way=fmean(e.fused**2 / e.variance for e in every),
        bias=_rms([e.bias for e in ends]),
    )


def _rms(values: list[float]) -> float:
    return math.sqrt(fmean(each * each for each in values))


def _quantile(values: list[float], share: float) -> float:
    return sorted(map(abs, values))[int(share * (len(values) - 1))]


def main() -> None:
    """Print the table of docs/odometry.md."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--scale", type=float, default=SCALE, help="the most that it is off")
    options = parser.parse_args()
    print(
        "| base | gyro | wheels alone | fused | ratio | median | 95 % | NEES | on the way | bias |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    with ProcessPoolExecutor(2) as pool:
        for geometry in ("skid_steer", "differential"):
            for sensor in SENSORS:
                seeds = range(options.runs)
                fixed = map(repeat, (sensor, geometry, options.seconds, options.scale))
                found = figures(list(pool.map(one, seeds, *fixed)))
                numbers = (f"{each:.3g}" for each in found)
                print("|", geometry, "|", sensor, "|", " | ".join(numbers), "|", flush=True)


if __name__ == "__main__":
    main()
