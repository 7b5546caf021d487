"""The heading from wheels and a gyro: a Kalman filter of four states and one measurement.

The wheels count the heading ``W = heading + e``, the gyro's integral is ``G = heading + c``. Both
errors begin at zero. The filter estimates

- ``e``, the error of the wheels' heading: a random walk, as fast as the wheels may slip;
- ``c``, the error of the gyro's heading: it grows by the bias and the noise;
- ``b``, the gyro's bias, which wanders with temperature;
- ``t``, the delay of the gyro's samples beyond the assumed one;

from what both can be compared by, ``W - G = e - c + t * rate``, known to a tick of the encoders.
The fused heading is ``W - e``. So

- standing wheels do not slip: ``e`` stays, and any change of ``W - G`` is bias;
- if the wheels are more certain than the gyro, the heading is theirs, to the tick; if they slip, it
  is the gyro's, less the learned bias;
- without a gyro nothing is measured: the heading continues by the wheels.

The states are augmented by the errors of the sensors (Maybeck, *Stochastic
Models, Estimation and Control*, volume 1, 4.11 and 5.3). If the two disagree by more than the
filter expects, the noise of the wheels is raised until they agree (Bar-Shalom, Li and Kirubarajan,
*Estimation with Applications to Tracking and Navigation*, 11.2: adjustable level process noise).

The error of the gyro's scale is considered and not estimated, because wheels that slip in every
turn look like it. ``pull`` is its effect on each state, per unit (Schmidt's filter).
"""

from __future__ import annotations

import math

BIAS_RAD_S = 0.09
"""Standard deviation of an unknown bias: the datasheets' zero, 5 degrees/s."""

BIAS_WALK = 1e-4
"""The bias wanders by this in a second, rad/s, and with the root of the time: a board whose sensor
warms up by 10 kelvin in five minutes."""

LATE_S = 0.015
"""Standard deviation of how late the gyro's samples are: filters, and waiting in the board."""

GATE = 25.0
"""The wheels slip if the square of the innovation is this many times its variance."""

E, C, B, T = range(4)
ZERO = (0.0, 0.0, 0.0, 0.0)


class HeadingFilter:
    """The states, and their covariance.

    Attributes:
        doubt: How badly all measurements fit: minus their log-likelihood, up to a constant for each
            step.
        slipped: Whether wheels and gyro disagreed at the latest step.
    """

    __slots__ = "_state _covariance _pull _apart doubt slipped".split()

    def __init__(self) -> None:
        self._state = list(ZERO)
        self._covariance = [list(ZERO) for _ in ZERO]
        self._covariance[B][B] = BIAS_RAD_S**2
        self._covariance[T][T] = LATE_S**2
        self._pull = list(ZERO)
        self._apart = 0.0
        self.doubt = 0.0
        self.slipped = False

    @property
    def error(self) -> float:
        """The wheels' heading less the fused one, radians."""
        return self._state[E]

    @property
    def bias(self) -> float:
        """The bias of the gyro, rad/s."""
        return self._state[B]

    @property
    def bias_variance(self) -> float:
        """The variance of the bias, (rad/s)^2."""
        return self._covariance[B][B]

    def variance(self, scale: float) -> float:
        """The variance of the error; a recent slip counts once the gyro has seen it.

        Args:
            scale: Standard deviation of the gyro's scale, as a share.
        """
        return self._covariance[E][E] + (scale * self._pull[E]) ** 2

    def reset(self) -> None:
        """Clear the errors of both headings; the knowledge of the gyro stays."""
        self._state[E] = self._state[C] = self._apart = 0.0
        self._pull = list(ZERO)
        for one in (E, C):
            for other in range(4):
                self._covariance[one][other] = self._covariance[other][one] = 0.0

    def learn(self, bias: float, variance: float, unsure: float) -> None:
        """Replace the bias.

        Args:
            bias: In rad/s.
            unsure: Variance that the heading gains from the error of the old bias, rad^2.
        """
        self._state[B], self._pull[B] = bias, 0.0
        for other in range(4):
            self._covariance[B][other] = self._covariance[other][B] = 0.0
        self._covariance[B][B] = variance
        for one in (E, C):
            for other in (E, C):
                self._covariance[one][other] += unsure

    def roll(self, slip: float, dt_s: float) -> None:
        """A step without a gyro: its turn is taken to be the wheels', with the same variance.

        Args:
            slip: Variance that the wheels' heading gains, rad^2.
        """
        covariance = self._covariance
        for one in (E, C):
            for other in (E, C):
                covariance[one][other] += slip
        covariance[B][B] += BIAS_WALK**2 * dt_s
        self.slipped = False

    def fuse(
        self,
        wheels: float,
        gyro: float,
        dt_s: float,
        *,
        rate: float,
        slip: float,
        noise: float,
        unsure: float,
    ) -> None:
        """A step that both measured.

        Args:
            wheels: The turn that the wheels counted, radians.
            gyro: The turn that the gyro integrated, with its bias.
            rate: The rate of turn at its end, by the gyro less its bias, rad/s.
            slip: Variance that the wheels' heading gains in it, rad^2.
            noise: Variance that the gyro's heading gains, rad^2.
            unsure: Variance of the comparison, at the end of the step.
        """
        state, p, pull = self._state, self._covariance, self._pull
        # Prediction: c grows by the bias. That row first, then that column.
        state[C] += state[B] * dt_s
        pull[C] += pull[B] * dt_s + gyro
        for each in range(4):
            p[C][each] += dt_s * p[B][each]
        for each in range(4):
            p[each][C] += dt_s * p[each][B]
        p[E][E] += slip
        p[C][C] += noise
        p[B][B] += BIAS_WALK**2 * dt_s
        # Measurement.
        self._apart += wheels - gyro
        innovation = self._apart - (state[E] - state[C] + rate * state[T])
        seen = [row[E] - row[C] + rate * row[T] for row in p]
        expected = seen[E] - seen[C] + rate * seen[T] + unsure
        misfit = innovation * innovation / expected
        self.doubt += 0.5 * (misfit + math.log(expected))
        self.slipped = misfit > GATE
        if self.slipped:
            more = innovation * innovation - expected
            p[E][E] += more
            seen[E] += more
            expected += more
        gains = [each / expected for each in seen]
        pulled = pull[E] - pull[C] + rate * pull[T]
        for one in range(4):
            state[one] += gains[one] * innovation
            pull[one] -= gains[one] * pulled
            for other in range(4):
                p[one][other] -= gains[one] * gains[other] * expected
