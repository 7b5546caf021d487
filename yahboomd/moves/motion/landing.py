"""The last millimetre: wait until the base stands, then correct the rest by short pulses.

A speed loop with an integral part drives, in the end, the whole way of a pulse: its speed times its
time. Only the part before the motors begin to turn is lost. It is small in the direction of
the motion before, and larger in the other one. Both are learned.

On a floor on which the wheels stick, a pulse that is over before they begin to turn moves nothing,
and many boards forget it. There a correction lasts until the counts begin: a nudge. It moves the
base by no less than the wheels jump when they break away, which is learned too.
"""

from __future__ import annotations

import math

import msgspec

PULSES = 12
"""The most corrections; after them the leg ends as it is."""

STANDS_S, ENDS_S, ENDS = 0.12, 0.08, 0.45
"""A base that did not move for the first time stands. At its goal the second is enough, or this
multiple of its motors' lag if that is longer, since slow motors swing back."""

LONGEST_S = 8.0
"""A longer landing ends as it is."""

NUDGES_S, LONGEST_NUDGE_S = 20.0, 4.0
"""The same for nudges, and for one of them."""

MOST_NUDGE_S = 1.0
IN_VAIN = 2
"""After so many pulses in a row that moved nothing the wheels stick."""

PUSHES_AFTER_S, PUSHES_PER_S = 0.5, 1.0
"""From when on, and by which share in a second, a wheel that sticks is pushed harder."""

LEARNS = 0.5


class Tolerance(msgspec.Struct, frozen=True, kw_only=True):
    """The tolerances of a leg's end, in m or rad.

    Attributes:
        end: The largest remaining error.
        aim: How far short of its end a base is to roll: a little short is better than too far.
        short: A base that stands farther from its end did not reach it.
        near: How far from its end a base may come to rest, by its model, before a next leg of the
            same move that corrects it.
        least: The same before one that cannot.
        still: A base that moves by less stands.
        creep: The least speed towards the end: below it a wheel may not turn at all.
        pulse: The speed of a correction.
    """

    end: float
    aim: float
    short: float
    near: float
    least: float
    still: float
    creep: float
    pulse: float


class RollOn(msgspec.Struct, kw_only=True):
    """The learned behaviour of the base after a zero, in m or rad.

    Attributes:
        landing: How much farther than the model predicts the base rolls at the end of a leg.
        same: The loss of a pulse in the direction of the motion before.
        other: The loss of a pulse in the other direction.
        most: The limit of each.
        sticks: Whether a pulse moved nothing: the wheels stick.
        nudge_s: How far the base moves after the zero that ends a nudge, over its speed then.
        jump: The smallest motion of a nudge.
    """

    landing: float
    same: float
    other: float
    most: float
    sticks: bool = False
    nudge_s: float = 0.12
    jump: float = 0.0

    def learn(self, name: str, error: float) -> None:
        """Correct one of them by a part of the error that it led to."""
        learned = getattr(self, name) + LEARNS * error
        setattr(self, name, max(0.0, min(self.most, learned)))


def pushed(speed: float, stood_s: float, most: float) -> float:
    """The speed for wheels that stick: more from a while on."""
    return min(most, speed * (1.0 + PUSHES_PER_S * max(0.0, stood_s - PUSHES_AFTER_S)))


class Landing:
    """Corrects until the rest of a leg is within its tolerance.

    Args:
        slowest: The slowest speed that starts the base; 0 if it is unknown.
        most: The largest speed.
    """

    def __init__(
        self, tolerance: Tolerance, rolls: RollOn, slowest: float = 0.0, most: float = math.inf
    ) -> None:
        self._pulses = 0
        self._tolerance = tolerance
        self._rolls = rolls
        self._slowest = max(slowest, tolerance.pulse)
        self._most = max(most, tolerance.pulse)
        self._rests_s = 0.0
        self._rested_at = math.inf
        self._since_s = 0.0
        self._way = 1.0
        self._pulse_left = 0.0
        self._in_vain = 0
        self._nudge_s: float | None = None
        self._nudged_at = self._nudge_speed = 0.0
        # Since the direction changed, without a motion.
        self._spent = 0.0
        self._began_at = 0.0
        self._kind = "landing"

    def step(self, left: float, rolling: float, dt_s: float, motor_s: float = 0.1) -> float | None:
        """The speed until the next step, negative for backward; None once it is over.

        Args:
            left: The rest of the leg.
            rolling: How much of it is under way by the model.
            dt_s: The time until the next step.
            motor_s: The time constant of the motors.
        """
        self._since_s += dt_s
        if self._nudge_s is not None:
            return self._nudge(left, dt_s)
        if self._since_s > (NUDGES_S if self._rolls.sticks else LONGEST_S):
            return None
        if self._pulse_left > 0.0:
            return self._pulse(dt_s)
        still = self._tolerance.still
        if abs(left - self._rested_at) > still or abs(rolling) > 2.0 * still:
            self._rested_at, self._rests_s = left, 0.0
        self._rests_s += dt_s
        end = self._tolerance.end
        there = max(abs(left), abs(left - rolling)) <= end
        if self._rests_s < (max(ENDS_S, ENDS * motor_s) if there else STANDS_S):
            return 0.0
        moved = self._way * (self._began_at - left)
        if self._kind == "landing":
            self._rolls.learn("landing", self._tolerance.aim - left)
        elif self._kind == "nudge":
            self._learn_nudge(left, moved)
        elif moved > still:
            lost = self._spent - moved
            self._rolls.learn(self._kind, lost - getattr(self._rolls, self._kind))
            self._kind, self._spent, self._in_vain = "same", 0.0, 0
        else:
            # The first may only have been too short for the direction.
            self._in_vain += 1
            self._rolls.sticks = self._rolls.sticks or self._in_vain >= IN_VAIN
        least = end
        if self._rolls.sticks:
            # A jump over the end has to leave less than is left now. The first one, of unknown
            # width, must be worth it.
            least = max(end, 0.5 * (self._rolls.jump or self._tolerance.short))
        if abs(left) <= least or self._pulses >= PULSES:
            return None
        self._pulses += 1
        way = math.copysign(1.0, left)
        if self._rolls.sticks:
            self._kind, self._nudge_s = "nudge", 0.0
            self._way, self._began_at = way, left
            return self._nudge(left, dt_s)
        if way != self._way or self._kind == "landing":
            self._kind = "same" if way == self._way else "other"
            self._spent = 0.0
        self._way, self._began_at = way, left
        # The loss of earlier pulses does not occur again.
        lost = max(0.0, getattr(self._rolls, self._kind) - self._spent)
        self._pulse_left = abs(left) + lost
        self._spent += self._pulse_left
        return self._pulse(dt_s)

    def _pulse(self, dt_s: float) -> float:
        speed = min(self._tolerance.pulse, self._pulse_left / dt_s)
        self._pulse_left -= speed * dt_s
        self._rested_at, self._rests_s = math.inf, 0.0
        return self._way * speed

    def _nudge(self, left: float, dt_s: float) -> float | None:
        """The speed of a nudge: until the counts begin, and the rest is what it rolls on."""
        assert self._nudge_s is not None
        if self._nudge_s:
            speed = self._way * (self._nudged_at - left) / dt_s
            self._nudge_speed += 0.5 * (speed - self._nudge_speed)
        else:
            self._nudge_speed = 0.0
        self._nudged_at = left
        begun = self._way * (self._began_at - left) > self._tolerance.still
        if not begun and self._nudge_s > LONGEST_NUDGE_S:
            return None
        if begun and self._way * left <= self._rolls.nudge_s * self._nudge_speed:
            self._nudge_s = None
            self._rested_at, self._rests_s = math.inf, 0.0
            return 0.0
        stood_s = 0.0 if begun else self._nudge_s
        self._nudge_s += dt_s
        speed = self._tolerance.pulse if begun else pushed(self._slowest, stood_s, self._most)
        return self._way * speed

    def _learn_nudge(self, left: float, moved: float) -> None:
        rolls, rolled = self._rolls, self._way * (self._nudged_at - left)
        if self._nudge_speed > 0.0:
            rolled_s = max(0.0, min(MOST_NUDGE_S, rolled / self._nudge_speed))
            # Boards differ most: some end a motion in 0.1 s, others let it glide for 0.6 s.
            rolls.nudge_s = rolled_s
        if rolls.jump:
            rolls.jump = min(rolls.jump, moved)
        elif self._way * left < 0.0:
            # It went too far: by no less than it jumps.
            rolls.jump = moved
