"""Predicts the pose of the base once it has obeyed all commands.

Wheels follow a command with a lag. The commanded way that is not driven yet is "under way":
the base drives it even if the next command is zero. Several models of the wheels run in parallel,
weighted by how well they explain the latest poses. A controller that acts on the predicted
pose instead of the measured one has a base without a lag (Smith, *Closer control of loops with dead
time*, 1957).

The models: a plain first-order lag; and a first-order motor behind a speed loop with
proportional and integral part, as the boards have it. All of them end a way at the commanded
length, so a wrong one delays the end but does not move it.
"""

from __future__ import annotations

import math

from yahboomd.core.model import Pose2d, Twist2d
from yahboomd.moves.motion.landing import RollOn

LAGS_S = (0.03, 0.05, 0.08, 0.12, 0.18, 0.26, 0.38, 0.55)
MOTORS_S = (0.05, 0.1, 0.17, 0.3)
GAINS = (0.4, 0.8, 1.5, 3.0)
INTEGRAL, DERIVATIVE = 0.075, 0.6
"""The other parts of the boards' loops, as shares of the proportional one, for steps of 10 ms."""

TRANSPORT_S = 0.03
"""The time from a command to the wheels' counts."""

ROLL = 1.25
"""The share of the way under way that a base may roll: more than the model's at low speeds, because
a board's measured speeds are then coarse. Too much only makes the end a little slower."""

LANDING, MOST_PER_S, FIRST_PER_S = 1.15, 10.0, 5.0
"""The speed at the end of a leg over the rest of its way: by the lag of the motors, and at most.
There the poses' steps and the models' errors are as large as the rest."""

LEARNED_S = 3.0
"""The time of driving that shows which models fit; until then the ends are slower."""

STEP_S = 0.01
AHEAD_STEPS = 80
FIRST_LAG_S = 0.12
MEMORY_S = 3.0
"""Older driving has little weight."""

WINDOW_S = 0.1
"""Ways are compared over this time: counts and stamps blur shorter ones."""

LEAST_WAY = 0.002
STOOD_S, STANDS_S = 0.35, 0.1
"""A base that did not move for the first time has nothing under way: its wheels stick, or it came
to rest. After the second it stands."""

STIRS_M, STIRS_RAD = 0.001, 0.006
"""A base that moves by less stands."""

SHARPNESS = 3.0
"""A model with half the squared error of another has eight times its weight."""

Way = list[float]
"""Ahead, to the left, turned: m, m, rad."""


class _Wheels:
    """One model: the speeds of the base along its three axes, for a command."""

    def __init__(self, motor_s: float, gain: float) -> None:
        self.motor_s = motor_s
        self._share = STEP_S / motor_s
        self._gain = gain
        self._integral = gain * INTEGRAL
        self._speed: Way = [0.0, 0.0, 0.0]
        self._sum: Way = [0.0, 0.0, 0.0]
        self._error: Way = [0.0, 0.0, 0.0]
        self.under_way: Way = [0.0, 0.0, 0.0]
        self.window: Way = [0.0, 0.0, 0.0]
        self.cost = 0.0

    @property
    def lag_s(self) -> float:
        return STEP_S / (self._integral if self._gain else self._share)

    def rest(self) -> None:
        """Stand, with nothing under way."""
        for each in (self._speed, self._sum, self._error, self.under_way, self.window):
            each[:] = (0.0, 0.0, 0.0)

    def peak(self, axis: int) -> float:
        """The extreme of the way from here, if the command is zero from now on.

        A speed loop with an integral part swings: the way passes its end and comes back.
        """
        speed, total, error = self._speed[axis], self._sum[axis], self._error[axis]
        way = peak = 0.0
        gain, integral = self._gain, self._integral
        for _ in range(AHEAD_STEPS):
            output = 0.0
            if gain:
                before, error = error, -speed
                total += integral * error
                output = total + gain * (error + DERIVATIVE * (error - before))
            speed += self._share * (output - speed)
            way += STEP_S * speed
            if abs(way) < abs(peak):
                break
            peak = way
        return peak

    def advance(self, twist: tuple[float, float, float]) -> None:
        """Obey a command for a step."""
        for axis, wanted in enumerate(twist):
            speed = self._speed[axis]
            output = wanted
            if self._gain:
                error, before = wanted - speed, self._error[axis]
                self._error[axis] = error
                self._sum[axis] += self._integral * error
                output = self._sum[axis] + self._gain * (error + DERIVATIVE * (error - before))
            speed += self._share * (output - speed)
            self._speed[axis] = speed
            self.under_way[axis] += STEP_S * (wanted - speed)
            self.window[axis] += STEP_S * speed


class LagModel:
    """The commands under way, by the models that fit the poses."""

    def __init__(self) -> None:
        self.slowest: Way = [0.0, 0.0, 0.0]
        """The slowest speed that starts the base, along each axis; 0 if it is unknown."""
        self._twist = (0.0, 0.0, 0.0)
        self._late = [self._twist] * round(TRANSPORT_S / STEP_S)
        self._on_the_wire: Way = [0.0, 0.0, 0.0]
        self._models = [_Wheels(lag_s, 0.0) for lag_s in LAGS_S]
        self._models += [_Wheels(motor_s, gain) for motor_s in MOTORS_S for gain in GAINS]
        self._weights = [
            1.0 / (1.0 + math.log(model.lag_s / FIRST_LAG_S) ** 2) ** SHARPNESS
            for model in self._models
        ]
        self.rolls = (_roll(0.001), _roll(0.001), _roll(0.01))
        self._rest_s = 0.0
        self._window_s = 0.0
        self._judged_s = 0.0
        self._seen: Way = [0.0, 0.0, 0.0]
        self._pose: Pose2d | None = None
        self._anchor: Pose2d | None = None
        self._unseen_s = 0.0
        self.stood_s = 0.0
        """How long it has not moved, from the latest command that was not zero after a zero."""

    @property
    def sticks(self) -> bool:
        """Whether it stood so long that nothing is under way, whatever is commanded."""
        return self.stood_s > STOOD_S

    @property
    def stands(self) -> bool:
        """Whether it stands."""
        return self.stood_s > STANDS_S

    def command(self, twist: Twist2d) -> None:
        """The velocity that is commanded from now on."""
        begins = not any(self._twist)
        self._twist = (twist.vx, twist.vy, twist.wz)
        if begins and any(self._twist):
            self.stood_s = 0.0

    def advance(self, dt_s: float) -> None:
        """Let time pass with the present command."""
        self._rest_s += dt_s
        self._unseen_s += dt_s
        while self._rest_s >= STEP_S:
            self._rest_s -= STEP_S
            self._window_s += STEP_S
            self._late.append((0.0, 0.0, 0.0) if self.sticks else self._twist)
            late = self._late.pop(0)
            for axis in range(3):
                self._on_the_wire[axis] += STEP_S * (self._late[-1][axis] - late[axis])
            for model in self._models:
                model.advance(late)

    def seen(self, pose: Pose2d) -> None:
        """Compare the way to a new pose with the ways of the models."""
        before, self._pose = self._pose, pose
        self._look(pose)
        if before is None:
            return
        turned = pose.theta - before.theta
        ahead, left = in_base(pose.x - before.x, pose.y - before.y, before.theta + turned / 2.0)
        for axis, way in enumerate((ahead, left, turned)):
            self._seen[axis] += way
        if self._window_s >= WINDOW_S:
            self._judge()

    def _look(self, pose: Pose2d) -> None:
        """Notice whether it moves."""
        anchor, since_s = self._anchor, min(STANDS_S, self._unseen_s)
        self._unseen_s = 0.0
        if (
            anchor is None
            or math.hypot(pose.x - anchor.x, pose.y - anchor.y) > STIRS_M
            or abs(pose.theta - anchor.theta) > STIRS_RAD
        ):
            self._anchor, self.stood_s = pose, 0.0
            return
        began = self.sticks
        self.stood_s += since_s
        if self.sticks and not began:
            for model in self._models:
                model.rest()
            self._late = [(0.0, 0.0, 0.0)] * len(self._late)
            self._on_the_wire = [0.0, 0.0, 0.0]

    def _judge(self) -> None:
        moved = math.hypot(*self._seen)
        if moved > LEAST_WAY:
            self._judged_s += self._window_s
            keep = math.exp(-self._window_s / MEMORY_S)
            for model in self._models:
                error = sum((a - b) ** 2 for a, b in zip(model.window, self._seen, strict=True))
                model.cost = model.cost * keep + error
            # The error of about one count, which no model can explain.
            least = min(model.cost for model in self._models) + 2e-7
            self._weights = [((least / (model.cost + 2e-7)) ** SHARPNESS) for model in self._models]
        for model in self._models:
            model.window[:] = (0.0, 0.0, 0.0)
        self._seen = [0.0, 0.0, 0.0]
        self._window_s = 0.0

    @property
    def lag_s(self) -> float:
        """The lag of the base: wheels, board, transport and poses together."""
        pairs = zip(self._weights, self._models, strict=True)
        mean_s: float = sum(weight * model.lag_s for weight, model in pairs) / sum(self._weights)
        return TRANSPORT_S + mean_s

    @property
    def motor_s(self) -> float:
        """The time constant of the motors; the slow ones of those that fit count most."""
        pairs = zip(self._weights, self._models, strict=True)
        square: float = sum(w * model.motor_s**2 for w, model in pairs) / sum(self._weights)
        return math.sqrt(square)

    @property
    def landing_per_s(self) -> float:
        """The speed towards the end of a leg, by the rest of its way."""
        most = FIRST_PER_S if self._judged_s < LEARNED_S else MOST_PER_S
        return min(most, LANDING / self.motor_s)

    @property
    def under_way(self) -> tuple[float, float, float]:
        """The commanded way that is not driven yet: ahead, to the left, turned."""
        total = sum(self._weights)
        way = list(self._on_the_wire)
        for weight, model in zip(self._weights, self._models, strict=True):
            for axis, each in enumerate(model.under_way):
                way[axis] += weight / total * each
        return way[0], way[1], way[2]

    @property
    def swing(self) -> tuple[float, float, float]:
        """How far each way passes its end before it comes back, if the next command is zero."""
        best = max(range(len(self._models)), key=self._weights.__getitem__)
        model = self._models[best]
        ahead, left, turned = (model.peak(axis) - model.under_way[axis] for axis in range(3))
        return ahead, left, turned

    def predicted(self, pose: Pose2d, share: float = 1.0) -> Pose2d:
        """The pose at which the base comes to rest, if the next command is zero.

        Args:
            pose: The newest pose.
            share: The share of the way under way that is driven.
        """
        ahead, left, turned = (share * each for each in self.under_way)
        half = turned / 2.0
        chord = math.sin(half) / half if abs(half) > 1e-4 else 1.0
        cosine, sine = math.cos(pose.theta + half), math.sin(pose.theta + half)
        return Pose2d(
            x=pose.x + chord * (cosine * ahead - sine * left),
            y=pose.y + chord * (sine * ahead + cosine * left),
            theta=pose.theta + turned,
        )

    def forget_pose(self) -> None:
        """Do not compare the next pose with the one before it."""
        self._pose = None


def in_base(dx: float, dy: float, theta: float) -> tuple[float, float]:
    """A step of the odometry frame along the axes of a base with this heading."""
    cosine, sine = math.cos(theta), math.sin(theta)
    return cosine * dx + sine * dy, cosine * dy - sine * dx


def _roll(first: float) -> RollOn:
    return RollOn(landing=first, same=0.2 * first, other=first, most=40.0 * first)
