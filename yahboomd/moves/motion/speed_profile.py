"""The speed along a course: within its limits, and always able to come to rest at the end.

Each step takes the largest acceleration from which the rest of the way suffices for a stop. With a
jerk limit the stop is the S-curve of Biagiotti and Melchiorri, *Trajectory Planning for Automatic
Machines and Robots*, 3.4: the deceleration grows, stays, and falls to zero together with the speed.
"""

from __future__ import annotations

import math

import msgspec

HALVINGS = 24
"""The halvings of the interval of accelerations in each step: to a ten-millionth of it."""


class SpeedLimits(msgspec.Struct, frozen=True, kw_only=True):
    """The limits of the speed along a course, in m and s, or in rad and s for a turn.

    Attributes:
        speed: The largest speed.
        acceleration: The largest gain of speed, and the planned loss of it.
        braking: The largest loss of speed, for a way that turns out shorter than planned.
        jerk: The largest change of the acceleration.
    """

    speed: float
    acceleration: float
    braking: float
    jerk: float


def stop_distance(speed: float, rate: float, limits: SpeedLimits) -> float:
    """The way to rest from a speed of 0 or more, with this present acceleration."""
    jerk = limits.jerk
    way = 0.0
    if rate > 0.0:
        # The acceleration has to fall to zero first.
        fade_s = rate / jerk
        way = speed * fade_s + rate * fade_s * fade_s / 3.0
        speed += rate * fade_s / 2.0
    elif rate < 0.0:
        # The rest of a stop that began at a higher speed.
        since_s = -rate / jerk
        before = speed - rate * since_s / 2.0
        peak = min(limits.acceleration, math.sqrt(before * jerk))
        if peak > -rate:
            begun = before * since_s + rate * since_s * since_s / 6.0
            return _stop_from_cruise(before, limits) - begun
        # The deceleration stays, until it and the speed fade together.
        fading = min(speed, rate * rate / (2.0 * jerk))
        return (fading * fading * 4.0 / 3.0 + speed * speed - fading * fading) / (-2.0 * rate)
    return way + _stop_from_cruise(speed, limits)


def _stop_from_cruise(speed: float, limits: SpeedLimits) -> float:
    if speed <= 0.0:
        return 0.0
    most = limits.acceleration
    if speed * limits.jerk >= most * most:
        return speed * (speed / most + most / limits.jerk) / 2.0
    return speed * math.sqrt(speed / limits.jerk)


def next_speed(
    speed: float,
    rate: float,
    dt_s: float,
    *,
    left: float,
    most: float,
    limits: SpeedLimits,
    landing_per_s: float = math.inf,
) -> tuple[float, float]:
    """The speed for the next step, and its acceleration.

    Args:
        speed: The present speed, 0 or more.
        rate: The present acceleration.
        dt_s: The length of the step.
        left: The rest of the way; none or less ends it within ``limits.braking``.
        most: The largest speed allowed here, such as in a curve.
        limits: The limits of the course.
        landing_per_s: The largest speed over the rest of the way.
    """

    def fits(change: float) -> bool:
        after = max(0.0, speed + change * dt_s)
        gain = change * change / (2.0 * limits.jerk) if change > 0.0 else 0.0
        return (
            after + gain <= most
            and after <= landing_per_s * left
            and after * dt_s + stop_distance(after, change, limits) <= left
        )

    low = max(-limits.acceleration, rate - limits.jerk * dt_s)
    high = max(low, min(limits.acceleration, rate + limits.jerk * dt_s))
    if not fits(low):
        # The way became shorter, or the curve tighter: exceed the jerk, then the deceleration.
        low, high = -limits.braking, low
        if not fits(low):
            return max(0.0, speed + low * dt_s), low
    if not fits(high):
        for _ in range(HALVINGS):
            middle = (low + high) / 2.0
            low, high = (middle, high) if fits(middle) else (low, middle)
        high = low
    after = max(0.0, speed + high * dt_s)
    return after, (after - speed) / dt_s


def ideal_time_s(way: float, limits: SpeedLimits) -> float:
    """The time from rest to rest of the ideal profile: the shortest within the limits.

    The profile is symmetrical: half of it is a stop. On a short way neither the speed nor, on a
    shorter one, the acceleration is reached.
    """
    way = abs(way)
    if way == 0.0:
        return 0.0
    top = limits.speed
    if 2.0 * _stop_from_cruise(top, limits) <= way:
        cruise = way - 2.0 * _stop_from_cruise(top, limits)
        return 2.0 * _stop_time_s(top, limits) + cruise / top
    low, high = 0.0, top
    for _ in range(2 * HALVINGS):
        middle = (low + high) / 2.0
        fits = 2.0 * _stop_from_cruise(middle, limits) <= way
        low, high = (middle, high) if fits else (low, middle)
    return 2.0 * _stop_time_s(low, limits)


def _stop_time_s(speed: float, limits: SpeedLimits) -> float:
    most = limits.acceleration
    if speed * limits.jerk >= most * most:
        return speed / most + most / limits.jerk
    return 2.0 * math.sqrt(speed / limits.jerk)
