"""Measures the heading by wheels and gyro against the wheels alone: ``make heading``.

A base drives about for ten minutes: straight, in curves, on the spot, with stops. Motors lag by 60
ms, and sensors are read as a board of 41 ms does. Its gyro is the simulator's, with the noise, zero
and warming of a datasheet, calibrated to 0.1 % of scale, its samples up to 20 ms older than
yahboomd assumes. There are 100 runs, each with another sensor, floor and way. A skid-steer base
acts on each square metre of floor as if it were up to 20 % wider or narrower than configured. The
other base is differential, and does not slip.

A second table has 30 runs of each of what makes a heading wrong (:data:`CASES`), a third a standing
base that is turned evenly.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from itertools import cycle, repeat
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
SCALES = {"mpu9250": 0.017, "icm20948": 0.009}
"""The standard deviation of the scale that yahboomd assumes of each."""

ACCELERATION_M_S2, ACCELERATION_RAD_S2, LAG_S = 2.5, 12.0, 0.06
LOOK_S = 10.0

SHAKES_RAD_S = 0.06, 0.1
"""Where a base shakes, its rate of turn does by so much beside the rate at which it is driven."""

ROLLERS = 9
GEAR = 20.0
"""Passing a contact: of a mecanum wheel in a turn, and of a gear in a turn of the wheel."""

UNEVEN = 0.03
"""By so much the speed of a wheel wanders, so that no vibration keeps its frequency."""

RECTIFIED_RAD_S = math.radians(0.1)
"""What vibration changes the zero of a gyro by, at most: as much as 1 g does, by the datasheet."""

SLIPS_DOWN = 0.25
"""The turn downhill of a base on a slope, in each metre, for a slope of one."""


class Case(NamedTuple):
    """What makes a heading wrong.

    Attributes:
        shaking: White noise of the rate of turn while the wheels turn: faster than the samples see.
        rollers: The rate ripples with the rollers of mecanum wheels.
        vibration: It ripples with the gears of the motors, and moves the zero of the gyro.
        one_side: The wheel of one side slips by 5 to 20 % on half of the floor.
        slope: The base creeps downhill on a floor that falls by 5 to 20 %.
        warming_k: In the ten minutes, at the time constant of the sensor.
        scale: The most that the gyro's scale is off.
        calibrated: yahboomd is configured so that it is calibrated.
        sign: Of the gyro.
    """

    geometry: str = "differential"
    shaking: bool = False
    rollers: bool = False
    vibration: bool = False
    one_side: bool = False
    slope: bool = False
    warming_k: float = 10.0
    scale: float = SCALE
    calibrated: bool = True
    sign: float = 1.0


CASES: dict[str, Case] = {
    "no slip": Case(),
    "shaking": Case(shaking=True),
    "vibration": Case(vibration=True),
    "temperature ramp": Case(warming_k=20.0),
    "slope": Case(slope=True),
    "one-sided slip": Case(one_side=True),
    "rollers": Case("mecanum", rollers=True),
    "skid steer, calibrated": Case("skid_steer"),
    "skid steer, shaking": Case("skid_steer", shaking=True),
    "skid steer, temperature ramp": Case("skid_steer", warming_k=20.0),
    "skid steer, 3 % uncalibrated": Case("skid_steer", scale=0.03, calibrated=False),
    "no slip, 3 % uncalibrated": Case(scale=0.03, calibrated=False),
    "one-sided slip, 3 % uncalibrated": Case(one_side=True, scale=0.03, calibrated=False),
    "skid steer, wrong sign": Case("skid_steer", sign=-1.0),
    "no slip, wrong sign": Case(sign=-1.0),
    "skid steer, wrong sign, uncalibrated": Case("skid_steer", sign=-1.0, calibrated=False),
}


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

    def __init__(self, seed: int, sensor: str, case: Case) -> None:
        self._random = random = Random(seed)
        options = msgspec.structs.replace(
            SENSORS[sensor],
            gyro_scale=case.scale,
            warming_k=case.warming_k,
            # Mounted as configured.
            axes="x y z",
        )
        self._case = case
        self._imu = ImuModel(options, random)
        self._late_ns = random.randrange(LATE_NS)
        self._unit = UNITS_RAD_S[sensor]
        self._floor: dict[tuple[int, int], float] = {}
        self._way = Way(random)
        self._phases = tuple(random.random() for _ in range(4))
        names = ("front_left", "rear_left", "rear_right", "front_right")
        names = names if case.geometry == "mecanum" else ("left", "right")
        # Half of the track and half of the base make the arm of a mecanum wheel.
        self._arm_m = 0.5 * TRACK_M * (2.0 if case.geometry == "mecanum" else 1.0)
        self.odometer = Odometer(
            KINEMATICS[case.geometry](separation_m=TRACK_M, base_m=TRACK_M),
            tuple(
                Motor(
                    name=name,
                    wheel=wheel,
                    position=wheel + 1,
                    radius_m=RADIUS_M,
                    ticks_per_revolution=TICKS,
                )
                for wheel, name in enumerate(names)
            ),
            fused=True,
            gyro_scale=case.scale / math.sqrt(3.0) if case.calibrated else None,
        )
        self._wheels = len(names)
        self.odometer.set_sample_period(round(CYCLE_S * 1e9), each_line=True)
        self._sensor = ImuSensor(
            name=sensor,
            gyro_limit_rad_s=options.gyro_limit_rad_s,
            gyro_noise_rad_s=options.gyro_density * math.sqrt(options.bandwidth_hz),
            gyro_scale=SCALES[sensor],
            acceleration_limit_m_s2=options.acceleration_limit_m_s2,
            acceleration_noise_m_s2=0.02,
        )
        self._shakes = random.uniform(*SHAKES_RAD_S)
        self._slip, self._side = random.uniform(0.05, 0.2), random.choice((-1.0, 1.0))
        self._slope, self._down = random.uniform(0.05, 0.2), random.uniform(0.0, 2.0 * math.pi)
        self._rectified = random.uniform(-RECTIFIED_RAD_S, RECTIFIED_RAD_S)
        self._ripples = [random.uniform(0.0, 2.0 * math.pi) for _ in range(4)]
        self._uneven = [0.0] * 4
        self._turning = 0.0
        self.theta = self._x = self._y = self._left = self._right = 0.0

    def drive(self, seconds: float) -> list[Look]:
        """Drive for some seconds, and record the heading every ten seconds."""
        looks: list[Look] = []
        now_s = 0.0
        per_cycle, imu_at = round(CYCLE_S / STEP_S), round(IMU_S / STEP_S)
        for number in range(round(seconds / CYCLE_S)):
            for step in range(per_cycle):
                if step == imu_at:
                    self._measure(round(now_s * 1e9))
                now_s = number * CYCLE_S + (step + 1) * STEP_S
                self._move(now_s)
            now_ns = round(now_s * 1e9)
            self._count(now_ns)
            if now_s >= LOOK_S * (len(looks) + 1):
                looks.append(self._look(now_ns))
        return looks

    def stand(self, seconds: float, rate_rad_s: float, *, since_s: float = 0.0) -> list[Look]:
        """Stand for some seconds on what turns evenly, and look each second."""
        looks: list[Look] = []
        imu_s = round(IMU_S / STEP_S) * STEP_S
        for number in range(round(seconds / CYCLE_S)):
            now_s = since_s + number * CYCLE_S
            self._turning = rate_rad_s
            self._measure(round((now_s + imu_s) * 1e9))
            self.theta += rate_rad_s * CYCLE_S
            self._count(round((now_s + CYCLE_S) * 1e9))
            if (number + 1) * CYCLE_S >= len(looks) + 1.0:
                looks.append(self._look(round((now_s + CYCLE_S) * 1e9)))
        return looks

    def _move(self, now_s: float) -> None:
        way, case = self._way, self._case
        way.follow(now_s, STEP_S)
        half = way.wz * self._arm_m
        self._left += (way.vx - half) * STEP_S
        self._right += (way.vx + half) * STEP_S
        turning = way.wz
        if case.geometry == "skid_steer":
            turning /= self._place(0.8, 1.2)
        elif case.rollers:
            turning /= self._place(0.9, 1.1)
        if case.one_side and self._place(-1.0, 1.0) > 0.0:
            speed = way.vx + self._side * half
            turning -= self._side * self._slip * speed / (2.0 * self._arm_m)
        if case.slope:
            rolled = abs(way.vx) + abs(half)
            turning += SLIPS_DOWN * self._slope * math.sin(self._down - self.theta) * rolled
        # A ripple turns the base by a milliradian to and fro, which is no part of its heading here.
        self._turning = turning + self._rippled(way.vx - half, way.vx + half)
        self.theta += turning * STEP_S
        self._x += way.vx * math.cos(self.theta) * STEP_S
        self._y += way.vx * math.sin(self.theta) * STEP_S

    def _rippled(self, left: float, right: float) -> float:
        """The rate of turn that the contacts of rollers or gears cause, at this moment."""
        case, random = self._case, self._random
        if not (case.rollers or case.vibration) or not (left or right):
            return 0.0
        contacts = ROLLERS if case.rollers else GEAR
        total = 0.0
        for wheel in range(self._wheels):
            speed = left if wheel < self._wheels // 2 else right
            uneven = self._uneven[wheel]
            # It wanders within a second or two.
            uneven += STEP_S * -uneven + UNEVEN * math.sqrt(2.0 * STEP_S) * random.gauss(0.0, 1.0)
            self._uneven[wheel] = uneven
            self._ripples[wheel] += contacts * speed * (1.0 + uneven) / RADIUS_M * STEP_S
            if speed:
                total += math.sin(self._ripples[wheel])
        # Root mean square.
        return self._shakes * math.sqrt(2.0 / self._wheels) * total

    def _place(self, least: float, most: float) -> float:
        """The floor here, drawn evenly for each square metre."""
        place = math.floor(self._x), math.floor(self._y)
        if place not in self._floor:
            self._floor[place] = self._random.uniform(least, most)
        return self._floor[place]

    def _measure(self, now_ns: int) -> None:
        case, way, rate = self._case, self._way, self._turning
        if way.vx or way.wz:
            if case.shaking:
                rate += self._shakes * self._random.gauss(0.0, 1.0)
            if case.vibration:
                rate += self._rectified
        if case.slope:
            # An acceleration of 1 g along it moves the zero by as much.
            rate += RECTIFIED_RAD_S * self._slope * math.cos(self._down - self.theta)
        shown = self._imu.sample(now_ns, Twist2d(vx=way.vx, wz=case.sign * rate), self.theta)
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
        half = self._wheels // 2
        travels = [self._left] * half + [self._right] * half
        counts = [
            math.floor(travel / TICK_M + phase)
            for travel, phase in zip(travels, self._phases, strict=False)
        ]
        self.odometer.update(
            EncoderReading(
                ticks=tuple([*counts, 0, 0][:4]),  # type: ignore[arg-type]
                received_ns=now_ns,
                sent_ns=now_ns,
                after_gap=now_ns < 50_000_000,
            )
        )

    def _look(self, now_ns: int) -> Look:
        estimate = self.odometer.estimate
        assert estimate is not None
        ticks, half = estimate.motor_ticks, self._wheels // 2
        # While it stands, the estimate may be a reading old, and has that stamp.
        theta = self.theta - self._turning * (now_ns - estimate.stamp_ns) * 1e-9
        turned = (sum(ticks[half:]) - sum(ticks[:half])) / half * TICK_M / (2.0 * self._arm_m)
        return Look(
            wheels=turned - theta,
            fused=estimate.pose.theta - theta,
            variance=estimate.pose_covariance[8],
            bias=self.odometer.gyro_bias_rad_s - self._imu.gyro_zero_rad_s(now_ns)[2],
        )


class Figures(NamedTuple):
    """Many runs in numbers: rad, and ratios of fused to wheels.

    Attributes:
        worse: The share of looks at which it is worse than the wheels by more than two sigma.
    """

    wheels: float
    fused: float
    ratio: float
    median: float
    p95: float
    nees: float
    nees_way: float
    bias: float
    worse: float


def one(seed: int, sensor: str, case: Case, seconds: float) -> list[Look]:
    """The looks of one run."""
    return Run(seed, sensor, case).drive(seconds)


def turned(seed: int, sensor: str, rate_rad_s: float) -> list[Look]:
    """A base that stood for ten seconds is turned evenly for as long, beside standing wheels."""
    run = Run(seed, sensor, Case())
    run.stand(10.0, 0.0)
    return run.stand(10.0, rate_rad_s, since_s=round(10.0 / CYCLE_S) * CYCLE_S)


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
        worse=fmean(abs(e.fused) > abs(e.wheels) + 2.0 * math.sqrt(e.variance) for e in every),
    )


def _rms(values: list[float]) -> float:
    return math.sqrt(fmean(each * each for each in values))


def _quantile(values: list[float], share: float) -> float:
    return sorted(map(abs, values))[int(share * (len(values) - 1))]


COLUMNS = "wheels alone", "fused", "ratio", "median", "95 %", "NEES", "on the way", "bias", "worse"
TURNS_RAD_S = 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 1.0


def _row(*cells: object) -> None:
    shown = (f"{each:.3g}" if isinstance(each, float) else str(each) for each in cells)
    print("|", " | ".join(shown), "|", flush=True)


def _head(*names: str) -> None:
    print()
    _row(*names)
    print("|" + "---|" * len(names))


def main() -> None:
    """Print the tables of docs/odometry.md."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--case-runs", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--case-seconds", type=float, default=300.0)
    parser.add_argument("--case", choices=CASES, action="append", help="only such")
    options = parser.parse_args()
    with ProcessPoolExecutor(2) as pool:
        if options.runs:
            _head("base", "gyro", *COLUMNS)
            for geometry in ("skid_steer", "differential"):
                for sensor in SENSORS:
                    fixed = map(repeat, (sensor, Case(geometry), options.seconds))
                    runs = list(pool.map(one, range(options.runs), *fixed))
                    _row(geometry, sensor, *figures(runs))
        seeds = range(options.case_runs)
        _head("case", *COLUMNS)
        for name in options.case or CASES:
            fixed = map(repeat, (CASES[name], options.case_seconds))
            _row(name, *figures(list(pool.map(one, seeds, cycle(SENSORS), *fixed))))
        _head("turned at", "error", "deviation by yahboomd", "NEES")
        for rate in TURNS_RAD_S:
            looks = list(pool.map(turned, seeds, cycle(SENSORS), repeat(rate)))
            found, ends = figures(looks), [each[-1].variance for each in looks]
            _row(rate, found.fused, math.sqrt(fmean(ends)), found.nees_way)


if __name__ == "__main__":
    main()
