"""The heading by wheels and gyro, step by step: how surely each knows it, and where they disagree.

Law: whatever becomes of the gyro, the heading goes on from where it is.

Two filters run side by side. One takes the wheels at their word, where the geometry lets them roll:
their heading is known to the tick. The other has them slip as much as the covariance of the wheels
says. The first is used until the measurements are so much likelier by the second that chance is no
explanation (a sequential test: Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to
Tracking and Navigation*, 11.6.2). So a base that does not slip loses nothing to the gyro's noise.
"""

from __future__ import annotations

import math

from yahboomd.core.model import Event, ImuReading
from yahboomd.core.odometry.gyro import Gyro, Problem
from yahboomd.core.odometry.heading_filter import HeadingFilter

TURN_SLIP: dict[str, float] = {"skid_steer": 0.04, "mecanum": 0.01, "ackermann": 0.01}
"""Variance of the wheels' turn for each radian, rad^2: what a floor makes of the effective track.
0.04 is 20 % of a turn by one radian."""

BELIEVED = 1e-6
"""The share of the rolling variance with which the filter that believes the wheels counts."""

REFUTED = 9.2
"""The other filter is 10,000 times likelier: the logarithm of that."""

TRUSTED = -10.0
"""However long the wheels were right: so soon their first slip is noticed."""

CALIBRATED = 6e-4
"""Standard deviation of a gyro's scale after it was calibrated to 0.1 %."""

TIMING_S = 0.003
"""By how much the times of samples vary, against each other."""

WINDOW_S = 1.0
SLIP_RAD = 0.1
SLIP_DEVIATIONS = 4.0
"""An event says so where the turns of a second differ by more than both."""

AGAINST_RAD = 0.3
"""A gyro that turns against the wheels over so much is mounted or configured otherwise."""
TURNING_RAD = 0.04
"""Windows in each of which the wheels turn so far, one way, are one turn."""

STEADY_S = 3.0
"""A gyro that shows one rate for so long beside wheels that stand shows its bias."""
STEADY_DEVIATIONS = 5.0
"""No hand turns a robot as evenly as within so many deviations of the sensor's noise."""


class Heading:
    """Fuses the turns of wheels and gyro, and says what is wrong with either.

    Args:
        counters: Where it is counted what goes wrong.
        tick_variance: Of the wheels' heading by the ticks of their encoders, rad^2.
        scale: Standard deviation of the gyro's scale where it was calibrated, as a share; None
            leaves it to the sensor.

    Attributes:
        events: What happened since they were taken.
    """

    __slots__ = (
        "_turn_slip _tick_variance _play _known_scale _scale _gyro _believing _doubting _angle"
        " _wheels _anchor _rate _window _way _rest _noise_rad_s _slipping _against _problem "
        "events _counters"
    ).split()

    def __init__(
        self,
        geometry: str,
        counters: dict[str, int],
        *,
        tick_variance: float,
        scale: float | None = None,
    ) -> None:
        self._turn_slip = TURN_SLIP.get(geometry, 0.0)
        self._tick_variance = tick_variance
        self._play = 1.5 * math.sqrt(6.0 * tick_variance)
        self._known_scale = scale
        self._scale = scale or 0.0
        self._gyro = Gyro()
        self._believing: HeadingFilter | None = HeadingFilter()
        self._doubting = HeadingFilter()
        self._angle: float | None = None
        self._wheels = self._anchor = 0.0
        self._rate: tuple[float, float] | None = None
        self._window, self._way = _Window(), _Window()
        self._rest = _Rest()
        self._slipping = self._against = False
        self._problem: Problem | None = None
        self.events: list[Event] = []
        self._counters = counters

    @property
    def _filter(self) -> HeadingFilter:
        return self._believing or self._doubting

    @property
    def _filters(self) -> tuple[HeadingFilter, ...]:
        both = self._believing, self._doubting
        return tuple(each for each in both if each is not None)

    @property
    def error(self) -> float:
        """By how much the wheels' heading is beyond the fused one, radians."""
        return self._filter.error

    @property
    def variance(self) -> float:
        """The variance that the fused heading gained since it was set, rad^2."""
        return self._filter.variance(self._scale)

    @property
    def bias_rad_s(self) -> float:
        """The gyro's reading at rest."""
        return self._filter.bias

    @property
    def bias_variance(self) -> float:
        """The variance of the bias, (rad/s)^2."""
        return self._filter.bias_variance

    @property
    def present(self) -> bool:
        """Whether there is a gyro, or was."""
        return self._gyro.present

    def rate(self, wheels_rad_s: float, variance: float) -> tuple[float, float]:
        """The rate of turn by both, each weighted by its certainty.

        Args:
            wheels_rad_s: By the wheels.
            variance: Of that, by the counts alone.

        Returns:
            The rate in rad/s, and its variance.
        """
        if self._rate is None:
            return wheels_rad_s, variance
        gyro_rad_s, gyro_variance = self._rate
        variance += self._turn_slip * wheels_rad_s * wheels_rad_s
        share = variance / (variance + gyro_variance)
        return wheels_rad_s + share * (gyro_rad_s - wheels_rad_s), share * gyro_variance

    def accept(self, reading: ImuReading) -> None:
        """Take in a sample of the sensor, along the axes of the base."""
        sensor = reading.sensor
        self._scale = sensor.gyro_scale if self._known_scale is None else self._known_scale
        self._noise_rad_s = sensor.gyro_noise_rad_s
        self._gyro.accept(
            reading.sent_ns - sensor.delay_ns,
            reading.gyro_rad_s[2],
            shown=(reading.gyro_rad_s, reading.acceleration_m_s2),
            limit_rad_s=sensor.gyro_limit_rad_s,
            noise_rad_s=sensor.gyro_noise_rad_s,
        )
        self._report_problem()

    def reset(self) -> None:
        """The heading was set: both are right now."""
        for each in self._filters:
            each.reset()

    def lose(self, variance: float) -> None:
        """The heading became so much less sure, rad^2, by what neither sensor saw."""
        for each in self._filters:
            each.roll(variance, 0.0)

    def fuse(self, turn: float, rolled: float, stamp_ns: int, step_ns: int) -> float:
        """Take in a step of the wheels.

        Args:
            turn: What they counted, radians.
            rolled: Variance of it by the distance that they rolled, rad^2.

        Returns:
            The turn to add to theirs.
        """
        before = self.error
        dt_s = step_ns * 1e-9
        slip = self._turn_slip * self._turned(turn)
        seen = self._gyro.turn(stamp_ns)
        angle, self._angle = self._angle, seen.angle if self._gyro.present else None
        gyro = None if angle is None else seen.angle - angle
        if gyro is not None and self._gyro.problem != "silent":
            self._compare(turn, gyro - self.bias_rad_s * dt_s, rolled + slip, dt_s)
            self._notice_bias(turn, gyro, dt_s)
        self._report_problem()
        if gyro is None or not self._gyro.believed or self._against:
            self._rate = None
            for each in self._filters:
                each.roll(rolled + slip, dt_s)
            return before - self.error
        # What its scale makes of a turn; the whole of it is in the filter's own account.
        noise = seen.noise + 0.25 * self._scale * self._scale * abs(gyro)
        rate = seen.rate_rad_s - self.bias_rad_s
        unsure = self._tick_variance + (TIMING_S * rate) ** 2 + seen.held * seen.held
        doubting = self._doubting
        doubting.fuse(turn, gyro, dt_s, rate=rate, slip=rolled + slip, noise=noise, unsure=unsure)
        if (believing := self._believing) is not None:
            slip += BELIEVED * rolled
            believing.fuse(turn, gyro, dt_s, rate=rate, slip=slip, noise=noise, unsure=unsure)
            self._judge(believing)
        self._rate = (rate, seen.noise / (dt_s * dt_s) + self._filter.bias_variance)
        return before - self.error

    def _judge(self, believing: HeadingFilter) -> None:
        doubting = self._doubting
        doubt = believing.doubt - doubting.doubt
        doubting.doubt = 0.0
        believing.doubt = max(TRUSTED, doubt)
        if doubt > REFUTED:
            self._believing = None

    def _turned(self, turn: float) -> float:
        """The turn of the wheels, but for the play in which ticks come and go."""
        self._wheels += turn
        low, high = self._wheels - self._play, self._wheels + self._play
        anchor = max(low, min(high, self._anchor))
        turned, self._anchor = abs(anchor - self._anchor), anchor
        return turned

    def _compare(self, wheels: float, gyro: float, slip: float, dt_s: float) -> None:
        """Does the gyro see what the wheels count, over a second?"""
        window = self._window
        window.wheels += wheels
        window.gyro += gyro
        window.slip += slip
        window.seconds += dt_s
        if window.seconds < WINDOW_S:
            return
        self._window = _Window()
        way = self._way
        if abs(window.wheels) < TURNING_RAD or window.wheels * way.wheels < 0.0:
            way = self._way = _Window()
        way.wheels += window.wheels
        way.gyro += window.gyro
        if min(abs(way.wheels), abs(way.gyro)) > AGAINST_RAD:
            self._against = way.wheels * way.gyro < 0.0
            self._way = _Window()
        apart = abs(window.wheels - window.gyro)
        least = max(SLIP_RAD, SLIP_DEVIATIONS * math.sqrt(window.slip))
        slipping = apart > least and self._gyro.believed and not self._against
        if slipping:
            self._counters["wheels_slipped"] += 1
            if not self._slipping:
                self.events.append(_slip(window))
        self._slipping = slipping

    def _notice_bias(self, wheels: float, gyro: float, dt_s: float) -> None:
        """A bias that is far from the learned one: the board started in motion, or was turned."""
        rest = self._rest
        if wheels or not self._gyro.believed:
            self._rest = _Rest()
            return
        rest.add(gyro / dt_s, dt_s)
        if rest.seconds < STEADY_S:
            return
        self._rest = _Rest()
        off = rest.mean - self.bias_rad_s
        unsure = STEADY_DEVIATIONS * self._noise_rad_s
        if rest.deviation > unsure or abs(off) < unsure + 5.0 * math.sqrt(self.bias_variance):
            return
        for each in self._filters:
            each.learn(rest.mean, rest.deviation**2, (off * rest.seconds) ** 2)
        self._gyro.refuse("implausible")

    def _report_problem(self) -> None:
        """Count a problem of the gyro; its beginning and its end are events."""
        problem = self._gyro.problem or ("implausible" if self._against else None)
        if problem == self._problem:
            return
        if problem is not None:
            self._counters[f"gyro_{problem}"] += 1
        if (problem is None) != (self._problem is None):
            self.events.append(_unfit(problem) if problem is not None else _FIT)
        self._problem = problem


class _Window:
    """The turns of the latest second."""

    __slots__ = "wheels gyro slip seconds".split()

    def __init__(self) -> None:
        self.wheels = self.gyro = self.slip = self.seconds = 0.0


class _Rest:
    """The rates of the gyro while the wheels stand."""

    __slots__ = "seconds _rates".split()

    def __init__(self) -> None:
        self.seconds = 0.0
        self._rates: list[float] = []

    def add(self, rate_rad_s: float, dt_s: float) -> None:
        self.seconds += dt_s
        self._rates.append(rate_rad_s)

    @property
    def mean(self) -> float:
        return math.fsum(self._rates) / len(self._rates)

    @property
    def deviation(self) -> float:
        mean = self.mean
        return math.sqrt(math.fsum((each - mean) ** 2 for each in self._rates) / len(self._rates))


_FIT = Event(
    kind="gyro_fit",
    severity="info",
    message="The gyro has behaved for a second: its rate of turn is used again.",
)

_CAUSES: dict[Problem, str] = {
    "silent": "The board sends no samples of its inertial sensor",
    "saturated": "The gyro is at its limit: the robot turns faster than it can measure",
    "implausible": (
        "The gyro shows what cannot be: it is stuck, its zero has jumped, or it turns against the "
        "wheels (then correct imu.axes or imu.gyro_axes)"
    ),
}


def _unfit(problem: Problem) -> Event:
    return Event(
        kind="gyro_unfit",
        severity="warning",
        message=f"{_CAUSES[problem]}. The heading goes on by the wheels alone until it has "
        "behaved for a second.",
        data={"problem": problem},
    )


def _slip(window: _Window) -> Event:
    return Event(
        kind="wheels_slip",
        severity="info",
        message=f"The wheels slip: they counted a turn of {window.wheels:.2f} rad in "
        f"{window.seconds:.1f} s, and the gyro saw {window.gyro:.2f} rad. With "
        'odometry.heading = "fused" the heading is the gyro\'s meanwhile.',
        data={
            "wheels_rad": round(window.wheels, 4),
            "gyro_rad": round(window.gyro, 4),
            "over_s": round(window.seconds, 3),
        },
    )
