"""The heading from wheels and gyro, step by step: how well each knows it, and their disagreements.

Law: when the gyro fails or returns, the heading continues from its present value.

Two filters run side by side. One trusts the wheels if the geometry lets them roll: their heading is
exact to the tick. The other lets them slip as much as the covariance of the wheels allows. The
first is used until the measurements are likelier under the second than chance can explain (a
sequential test: Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to
Tracking and Navigation*, 11.6.2). So a base that does not slip loses nothing to the gyro's noise.
"""

from __future__ import annotations

import math

from yahboomd.core.model import Event, ImuReading
from yahboomd.core.odometry.gyro import Gyro, Problem
from yahboomd.core.odometry.heading_filter import BIAS_RAD_S, GATE, LATE_S, HeadingFilter

BELIEVED = 1e-6
"""The share of the rolling variance that the filter that trusts the wheels assumes."""

REFUTED = 7.0
"""The other filter takes over when it is 1,100 times likelier: the logarithm of that."""

TRUSTED = -8.0
"""Caps accumulated trust, so that the first slip is noticed quickly."""

CATCH_UP_RAD_S = 0.2
"""The fastest correction beyond the difference that a step itself shows. A pose never jumps
(REP 105), even if a slip is found late or one filter replaces the other."""

CALIBRATED = 6e-4
"""Standard deviation of the scale of a gyro that was calibrated to 0.1 %."""

TIMING_S = 0.003
"""How much the times of samples vary against each other."""

WINDOW_S = 1.0
SLIP_RAD = 0.1
SLIP_DEVIATIONS = 4.0
"""An event reports turns that differ by more than both within a second."""

CLEAR_RAD = 0.6
"""Turns of the wheels that add up to this, either way, can show the sign of the gyro."""
CLEAR_SHARE = 0.6
"""... if the sum of products is at least this share of the larger sum of squares, over seconds."""
SLOWEST_RAD = 0.002
"""With a smaller turn in a second the ticks of a wheel may only come and go."""

STEADY_S = 3.0
"""A gyro with one rate for this time beside standing wheels shows its bias, or an even turn."""
STEADY_DEVIATIONS = 5.0
"""No hand turns a robot more evenly than this many deviations of the sensor's noise."""
EVEN_SAMPLES = 4
UNEVEN_DEVIATIONS = 10.0
"""A sample this far from the mean of at least ``EVEN_SAMPLES`` begins another rate."""
DRIFT_RAD_S2 = 4e-4
"""No temperature changes a bias faster: 0.24 degrees/s for a kelvin, 0.1 kelvin in a second."""
PLAUSIBLE_RAD_S = 0.35
"""No bias is larger: 20 degrees/s, the initial tolerance by the datasheet of an MPU-6050. That of
an MPU-9250 or ICM-20948 is 5, and 5 more for 20 kelvin."""

FEW_SAMPLES = 10
UNMEASURED_RAD_S = 0.1
"""How much a base may shake before ``FEW_SAMPLES`` samples in motion show it."""

SHAKEN_S = 0.1
"""Shaking at nearly the rate of the samples looks slow: the error is its rate over this time."""


class Heading:
    """Fuses the turns of wheels and gyro, and reports problems of either.

    Args:
        counters: The counters of the problems.
        tick_variance: Variance of the wheels' heading from the ticks of their encoders, rad^2.
        scale: Standard deviation of a calibrated gyro's scale, as a share; None takes the sensor's,
            and the gyro's sign from the first clear turn.
        fused: The heading is used, so a gyro that cannot be used yet is reported.

    Attributes:
        events: New events; the caller clears them.
    """

    __slots__ = (
        "_turn_slip _tick_variance _play _known_scale _scale _fused _gyro _believing _doubting "
        "_angle _wheels _anchor _parted _error _rate _window _apart _way _sign _added _rest "
        "_doubted _noise_rad_s _slipping _problem events _counters"
    ).split()

    def __init__(
        self,
        turn_slip: float,
        counters: dict[str, int],
        *,
        tick_variance: float,
        scale: float | None = None,
        fused: bool = True,
    ) -> None:
        self._turn_slip = turn_slip
        self._tick_variance = tick_variance
        self._play = 1.5 * math.sqrt(6.0 * tick_variance)
        self._known_scale = scale
        self._scale = scale or 0.0
        self._gyro = Gyro()
        self._believing: HeadingFilter | None = HeadingFilter()
        self._doubting = HeadingFilter()
        self._angle: float | None = None
        self._wheels = self._anchor = self._parted = self._error = 0.0
        self._rate: tuple[float, float] | None = None
        self._fused = fused
        self._window, self._apart, self._way = _Turns(), _Turns(), _Turns()
        self._sign = 0
        self._added = [0.0, 0.0, 0.0]
        self._rest = _Rest(0.0, BIAS_RAD_S**2)
        self._slipping = self._doubted = False
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
        """The wheels' heading less the fused one, radians."""
        return self._error

    @property
    def variance(self) -> float:
        """The variance that the fused heading gained since it was set, rad^2."""
        believing, doubting = self._believing, self._doubting
        variance = self._filter.variance(self._scale) + self._rest.pending
        variance += (self._filter.error - self._error) ** 2
        if self._sign == 0 and self._way.both + self._window.wheels * self._window.gyro < 0.0:
            variance += sum(self._added) ** 2
        if believing is None:
            return variance
        # The other may be right since they parted, as likely as the measurements make it.
        share = 1.0 / (1.0 + math.exp(0.5 * TRUSTED - believing.doubt))
        return variance + share * (believing.error - doubting.error - self._parted) ** 2

    @property
    def bias_rad_s(self) -> float:
        """The gyro's reading at rest, rad/s."""
        return self._filter.bias

    @property
    def bias_variance(self) -> float:
        """The variance of the bias, (rad/s)^2."""
        return self._filter.bias_variance

    @property
    def present(self) -> bool:
        return self._gyro.present

    def rate(self, wheels_rad_s: float, variance: float) -> tuple[float, float]:
        """The rate of turn from both, each weighted by its certainty.

        Args:
            wheels_rad_s: The rate from the wheels.
            variance: Its variance, from the counts alone.

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
        """Clear the errors of both, after the heading was set."""
        for each in self._filters:
            each.reset()
        self._added, self._apart = [0.0, 0.0, 0.0], _Turns()
        self._parted = self._error = 0.0

    def lose(self, variance: float) -> None:
        """Add variance, rad^2, for a turn that neither sensor saw.

        The board may have restarted, which gives its gyro another zero.
        """
        self._learn(self.bias_rad_s, BIAS_RAD_S**2, variance)
        self._rest = _Rest(self.bias_rad_s, BIAS_RAD_S**2)

    def _learn(self, bias: float, variance: float, unsure: float) -> None:
        for each in self._filters:
            each.learn(bias, variance, unsure)

    def _lose_to(self, variance: float, granted: float) -> float:
        """Add the variance beyond the one already granted, and return the addition."""
        more = max(0.0, variance - granted)
        for each in self._filters:
            each.roll(more, 0.0)
        return more

    @property
    def _unchecked(self) -> bool:
        return self._sign == 0 and self._known_scale is None

    @property
    def _used(self) -> bool:
        checked = self._sign >= 0 and not self._unchecked
        return checked and self._gyro.believed and not self._doubted

    def fuse(self, turn: float, rolled: float, stamp_ns: int, step_ns: int) -> float:
        """Take in a step of the wheels.

        Args:
            turn: The turn that they counted, radians.
            rolled: Its variance from the distance rolled, rad^2.

        Returns:
            The turn to add to theirs.
        """
        dt_s = step_ns * 1e-9
        slip = self._turn_slip * self._turned(turn)
        seen = self._gyro.turn(stamp_ns)
        angle, self._angle = self._angle, seen.angle if self._gyro.present else None
        gyro = None if angle is None else seen.angle - angle
        moving = self._gyro.moving = bool(turn or rolled)
        if gyro is not None and self._gyro.problem != "silent":
            self._compare(turn, gyro - self.bias_rad_s * dt_s, rolled + slip, dt_s)
            self._notice_bias(moving, gyro, dt_s)
        self._report_problem()
        if gyro is None or not self._used:
            self._rate = None
            for each in self._filters:
                each.roll(rolled + slip, dt_s)
            return self._catch_up(CATCH_UP_RAD_S * dt_s)
        # The error of the scale in this turn; the filter keeps the exact account itself.
        noise = seen.noise + 0.25 * self._scale * self._scale * abs(gyro)
        rate = shown = seen.rate_rad_s - self.bias_rad_s
        unsure = self._tick_variance + (TIMING_S * rate) ** 2 + seen.held * seen.held
        shaking = self._gyro.shaking
        if moving:
            unsure += shaking * SHAKEN_S * SHAKEN_S
        else:
            # The base may shake before the first tick, and after the last.
            unsure += shaking * dt_s * dt_s
            unknown = self._noise_rad_s**2 + shaking + self.bias_variance
            if (rate * dt_s) ** 2 > GATE * (unknown * dt_s * dt_s + self._tick_variance):
                # The base is being turned, or begins to shake. The delay of samples is uncertain.
                slip += (rate * dt_s) ** 2
                unsure += rate * rate * (LATE_S * LATE_S + dt_s * dt_s)
            rate = 0.0
        doubting = self._doubting
        # A slip lasts for seconds: its deviation is taken as twice the difference in this step.
        apart = turn - gyro + doubting.bias * dt_s
        slipped = max(rolled + slip, 4.0 * apart * apart if moving else 0.0)
        doubting.fuse(turn, gyro, dt_s, rate=rate, slip=slipped, noise=noise, unsure=unsure)
        if (believing := self._believing) is not None:
            slip += BELIEVED * rolled
            if few := moving and self._gyro.shaken < FEW_SAMPLES:
                unsure += (UNMEASURED_RAD_S * SHAKEN_S) ** 2
            believing.fuse(turn, gyro, dt_s, rate=rate, slip=slip, noise=noise, unsure=unsure)
            if few:
                believing.doubt = doubting.doubt = 0.0
            self._judge(believing)
        self._rate = (shown, seen.noise / (dt_s * dt_s) + self._filter.bias_variance)
        added = self._catch_up(abs(apart) + CATCH_UP_RAD_S * dt_s)
        self._added[0] += added
        return added

    def _catch_up(self, most: float) -> float:
        """Correct by the filter's error, without a jump; the turn to add to the wheels'."""
        missing = max(-most, min(most, self._filter.error - self._error))
        self._error += missing
        return -missing

    def _judge(self, believing: HeadingFilter) -> None:
        doubting = self._doubting
        doubt = believing.doubt - doubting.doubt
        doubting.doubt = 0.0
        believing.doubt = max(TRUSTED, doubt)
        if doubt <= TRUSTED:
            self._parted = believing.error - doubting.error
        if doubt > REFUTED:
            self._believing = None

    def _turned(self, turn: float) -> float:
        """The turn of the wheels, without the play in which ticks come and go."""
        self._wheels += turn
        low, high = self._wheels - self._play, self._wheels + self._play
        anchor = max(low, min(high, self._anchor))
        turned, self._anchor = abs(anchor - self._anchor), anchor
        return turned

    def _compare(self, wheels: float, gyro: float, slip: float, dt_s: float) -> None:
        window = self._window
        window.wheels += wheels
        window.gyro += gyro
        window.slip += slip
        window.seconds += dt_s
        if window.seconds < WINDOW_S:
            return
        self._window = _Turns()
        if self._gyro.believed:
            self._check_sign(window)
        if self._sign > 0:
            self._added = [0.0, *self._added[:2]]
        apart = abs(window.wheels - window.gyro)
        least = max(SLIP_RAD, SLIP_DEVIATIONS * math.sqrt(window.slip))
        slipping = apart > least and self._used
        if slipping:
            self._counters["wheels_slipped"] += 1
            if not self._slipping:
                self.events.append(_slip(window))
        self._slipping = slipping

    def _check_sign(self, window: _Turns) -> None:
        """Check whether the gyro turns with the wheels; once proved, this is final."""
        way, apart = self._way, self._apart
        if self._unchecked:
            # With either sign of the gyro, the wheels slipped by at least this.
            apart.wheels += window.wheels
            apart.gyro += window.gyro
            apart.seconds += window.seconds
            unknown = 3.0 * math.sqrt(self.bias_variance) * apart.seconds
            least = max(0.0, abs(abs(apart.wheels) - abs(apart.gyro)) - unknown)
            apart.slip += self._lose_to(least * least, apart.slip)
        if self._sign > 0 or abs(window.wheels) < SLOWEST_RAD:
            return
        way.turned += abs(window.wheels)
        way.wheels_2 += window.wheels * window.wheels
        way.gyro_2 += window.gyro * window.gyro
        way.both += window.wheels * window.gyro
        if way.turned < CLEAR_RAD:
            return
        self._way = _Turns()
        if abs(way.both) > CLEAR_SHARE * max(way.wheels_2, way.gyro_2):
            self._sign = 1 if way.both > 0.0 else -1

    def _notice_bias(self, moving: bool, gyro: float, dt_s: float) -> None:
        """Decide whether an even rate beside standing wheels is the bias, a new one, or a turn."""
        rest = self._rest
        if moving or not self._gyro.believed:
            rest.clear()
            if self._doubted and moving and abs(rest.shown) <= PLAUSIBLE_RAD_S:
                # A bias or a turn: the moving wheels will show which.
                self._learn(rest.shown, (rest.shown - rest.zero) ** 2, 0.0)
                self._doubted = False
            if not self._doubted:
                self._rest = _Rest(self.bias_rad_s, self.bias_variance)
            return
        noise, rate = self._noise_rad_s, gyro / dt_s
        if len(rest.rates) >= EVEN_SAMPLES and abs(rate - rest.mean) > UNEVEN_DEVIATIONS * noise:
            # Another rate begins.
            rest.clear()
            if not self._doubted:
                rest.turned = 0.0
        rest.add(rate, dt_s)
        if self._doubted:
            # The base turned or it did not: the heading gets the difference as variance.
            rest.granted += self._lose_to(rest.turned**2, rest.granted)
        elif len(rest.rates) > EVEN_SAMPLES:
            known = rest.variance * rest.seconds**2 + noise * noise * rest.seconds * dt_s
            odd = rest.turned**2 > 9.0 * known and abs(rest.mean) <= PLAUSIBLE_RAD_S
            rest.pending = rest.turned**2 if odd else 0.0
        if rest.seconds < STEADY_S:
            return
        mean, samples = rest.mean, len(rest.rates)
        variance = math.fsum((each - mean) ** 2 for each in rest.rates) / samples
        rest.clear()
        if variance > (STEADY_DEVIATIONS * noise) ** 2:
            return
        drift, mean_variance = DRIFT_RAD_S2 * STEADY_S, variance / samples
        near = drift + STEADY_DEVIATIONS * math.sqrt(rest.variance + mean_variance)
        off = mean - self.bias_rad_s
        if (plausible := abs(mean) <= PLAUSIBLE_RAD_S) and abs(mean - rest.zero) <= near:
            wrong = STEADY_DEVIATIONS * math.sqrt(self.bias_variance + mean_variance)
            if not self._used or abs(off) > drift + wrong:
                self._learn(mean, variance, (off * STEADY_S) ** 2)
            self._doubted = False
            self._rest = _Rest(mean, mean_variance)
            return
        if not plausible:
            # The filter took a turn for a bias: restore the last one.
            self._learn(rest.zero, rest.variance, (STEADY_S * (self.bias_rad_s - rest.zero)) ** 2)
        if plausible or STEADY_DEVIATIONS * math.sqrt(rest.variance) > PLAUSIBLE_RAD_S:
            rest.shown, self._doubted = mean, True
        else:
            # The bias was known: this is a turn.
            rest.turned = rest.granted = 0.0

    def _report_problem(self) -> None:
        problem: Problem | None = self._gyro.problem
        if problem is None and (self._sign < 0 or self._doubted):
            problem = "implausible"
        elif problem is None and self._fused and self.present and self._unchecked:
            problem = "unchecked"
        if problem == self._problem:
            return
        if problem is not None:
            self._counters[f"gyro_{problem}"] += 1
        if problem == "implausible":
            # Its latest corrections may be wrong: add their variance and keep the heading.
            self._lose_to(sum(self._added) ** 2, 0.0)
            self._added = [0.0, 0.0, 0.0]
        if problem is None:
            self.events.append(_FIT)
        elif self._problem in {None, "unchecked"}:
            self.events.append(_unfit(problem))
        self._problem = problem


class _Turns:
    """Sums of the turns of wheels and gyro, of their squares, and of their products."""

    __slots__ = "wheels gyro slip seconds turned wheels_2 gyro_2 both".split()

    def __init__(self) -> None:
        self.wheels = self.gyro = self.slip = self.seconds = 0.0
        self.turned = self.wheels_2 = self.gyro_2 = self.both = 0.0


class _Rest:
    """The rates of the gyro while the wheels stand.

    Attributes:
        zero: The bias that it showed before.
        pending: Variance for an even rate that may be a turn, while undecided, rad^2.
        turned: The turn until now, if the rate is one, radians.
        granted: The variance that the heading has for it.
        shown: The latest even rate that differs from the bias.
    """

    __slots__ = "zero variance turned granted pending shown seconds rates".split()

    def __init__(self, zero: float, variance: float) -> None:
        self.zero, self.variance = zero, variance
        self.turned = self.granted = self.shown = 0.0
        self.clear()

    def clear(self) -> None:
        self.seconds = self.pending = 0.0
        self.rates: list[float] = []

    def add(self, rate_rad_s: float, dt_s: float) -> None:
        self.seconds += dt_s
        self.turned += (rate_rad_s - self.zero) * dt_s
        self.rates.append(rate_rad_s)

    @property
    def mean(self) -> float:
        return math.fsum(self.rates) / len(self.rates)


_FIT = Event(
    kind="gyro_fit",
    severity="info",
    message="The gyro's rate of turn is used from now on: it has behaved for a second, or turned "
    "with the wheels.",
)

_CAUSES: dict[Problem, str] = {
    "silent": "The board sends no samples of its inertial sensor",
    "saturated": "The gyro is at its limit: the robot turns faster than it can measure",
    "implausible": (
        "The gyro's rate is implausible: it is stuck, its zero jumped, the ground under it turns, "
        "or it turns against the wheels (then correct imu.axes or imu.gyro_axes)"
    ),
    "unchecked": (
        "Which way the gyro turns was not checked: imu.gyro_scale is absent. Run `yahboomd "
        "calibrate imu`, or drive one clear turn, of 35 degrees"
    ),
}


def _unfit(problem: Problem) -> Event:
    return Event(
        kind="gyro_unfit",
        severity="warning",
        message=f"{_CAUSES[problem]}. The heading goes on by the wheels alone until the "
        "event gyro_fit.",
        data={"problem": problem},
    )


def _slip(window: _Turns) -> Event:
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
