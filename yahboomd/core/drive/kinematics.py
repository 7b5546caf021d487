"""Turns motion of the body into rim speeds of the wheels, and back, for every drive geometry.

One law: each geometry is two constant matrices. ``inverse`` turns (vx, vy, wz) into rim speeds,
``forward`` turns rim speeds back, and ``forward`` after ``inverse`` is the identity (on motion that
the geometry can make). Another geometry is one builder and one row of :data:`KINEMATICS`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec

from yahboomd.core.errors import ConfigError
from yahboomd.core.model import Kinematics, Motor, Twist2d

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


STEERING_MAX_RAD = math.pi / 4.0
"""The largest angle of the front wheels of the boards' cars: 45 degrees."""


def differential(*, separation_m: float, **_: float | None) -> Kinematics:
    """Two driven sides on one axle.

    ``v_left = vx - wz b/2``, ``v_right = vx + wz b/2`` with b the distance of the wheels; the
    base cannot move sideways.

    Args:
        separation_m: From the left wheel's contact point to the right one's.

    Raises:
        ConfigError: ``separation_m`` is not a positive number.
    """
    return _two_sides("differential", separation_m)


def skid_steer(*, separation_m: float, **_: float | None) -> Kinematics:
    """Two sides of several wheels each, which slip sideways in a turn.

    The same maps as :func:`differential`, with the *effective* separation: published bases turn as
    if they were 1.3 to 1.9 times as wide as they are, so it has to be calibrated.

    Args:
        separation_m: The effective distance of the sides.

    Raises:
        ConfigError: ``separation_m`` is not a positive number.
    """
    sides = _two_sides("skid_steer", separation_m)
    return msgspec.structs.replace(sides, sides=True, turn_slip=0.04)


def mecanum(
    *, separation_m: float, base_m: float | None = None, sideways: float = 1.0, **_: float | None
) -> Kinematics:
    """Four wheels with rollers at 45 degrees, which can also move sideways.

    With k = (separation + base) / 2 the rim speeds are front left ``vx - vy - k wz``, rear left
    ``vx + vy - k wz``, front right ``vx + vy + k wz``, rear right ``vx - vy + k wz``. Four wheels
    for three unknowns: ``forward`` is the least-squares solution (the columns of ``inverse`` are
    orthogonal, so it is the scaled transpose), and its residual is slip.
    The order of the wheels is that of the vendor's M1 to M4.

    The rollers slip most in sideways motion, by 5 to 20 % of the way: ``vy`` in these formulas is
    the rolled way, and the base goes ``sideways`` times as far.

    Args:
        separation_m: Left to right, between the wheels' middles.
        base_m: Front to rear, between the axles.
        sideways: The true way to the side, for each metre that the wheels count.

    Raises:
        ConfigError: A distance is missing, or not a positive number.
    """
    _positive("wheel_separation_m", separation_m)
    _positive("sideways_multiplier", sideways)
    if base_m is None:
        raise ConfigError(
            "A mecanum base needs the distance of its axles.",
            remedy="Set chassis.wheel_base_m, front to rear, in metres.",
        )
    _positive("wheel_base_m", base_m)
    k = (separation_m + base_m) / 2.0
    q, s = 0.25, 1.0 / sideways
    qs = q * sideways
    return Kinematics(
        name="mecanum",
        wheels=("front_left", "rear_left", "front_right", "rear_right"),
        inverse=((1.0, -s, -k), (1.0, s, -k), (1.0, s, k), (1.0, -s, k)),
        forward=(
            (q, q, q, q),
            (-qs, qs, qs, -qs),
            (-q / k, -q / k, q / k, q / k),
        ),
        holonomic=True,
        base_m=base_m,
        turn_slip=0.01,
    )


def ackermann(
    *,
    separation_m: float,
    base_m: float | None = None,
    steering_max_rad: float = STEERING_MAX_RAD,
    **_: float | None,
) -> Kinematics:
    """A car: two driven rear wheels, and front wheels that steer.

    The rear wheels turn as those of :func:`differential`. The middle of their axle, which is the
    base's origin, drives curves of ``base / tan(angle)`` and more, and cannot turn on the spot
    (Siegwart, Nourbakhsh and Scaramuzza, *Autonomous Mobile Robots*, 3.2).

    Args:
        separation_m: From the left rear wheel's contact point to the right one's.
        base_m: From the rear axle to the front one.
        steering_max_rad: The largest angle of the steering, of a wheel in the middle.

    Raises:
        ConfigError: A distance is missing, or not a positive number, or the angle is none.
    """
    if base_m is None:
        raise ConfigError(
            "A car that steers needs the distance of its axles.",
            remedy="Set chassis.wheel_base_m, front to rear, in metres.",
        )
    _positive("wheel_base_m", base_m)
    if not 0.0 < steering_max_rad < math.pi / 2.0:
        raise ConfigError(f"chassis.steering_max_rad is {steering_max_rad}, which is no angle.")
    return msgspec.structs.replace(
        _two_sides("ackermann", separation_m),
        base_m=base_m,
        least_radius_m=base_m / math.tan(steering_max_rad),
        turn_slip=0.01,
    )


KINEMATICS: Mapping[str, Callable[..., Kinematics]] = {
    "differential": differential,
    "skid_steer": skid_steer,
    "mecanum": mecanum,
    "ackermann": ackermann,
}
"""The drive geometries, by the name that ``chassis.kinematics`` gives.

Each is called with ``separation_m``, ``base_m``, ``steering_max_rad`` and ``sideways``, and ignores
those that it does not use."""


def unit_geometry(name: str) -> Kinematics:
    return KINEMATICS[name](separation_m=1.0, base_m=1.0)


def wheel_speeds(kinematics: Kinematics, twist: Twist2d) -> tuple[float, ...]:
    """The rim speed of each wheel in m/s, in the order of ``kinematics.wheels``.

    A geometry that cannot move sideways ignores ``vy``.
    """
    vx, vy, wz = twist.vx, twist.vy, twist.wz
    # A list costs half as much as a generator; this and the next run in every control step.
    return tuple([fx * vx + fy * vy + fw * wz for fx, fy, fw in kinematics.inverse])


def motor_speeds(motors: Sequence[Motor], speeds: Sequence[float]) -> tuple[float, ...]:
    """The rim speed of each motor's wheel, m/s, positive forward, from the speeds of the wheels."""
    return tuple([speeds[motor.wheel] for motor in motors])


def desaturate(speeds: Sequence[float], limits: Sequence[float]) -> tuple[tuple[float, ...], float]:
    """Slow all wheels by one factor until the fastest fits, so that the path keeps its curvature.

    Clipping each wheel by itself would bend the path. If a speed is not finite (a wish that
    overflowed), all become zero.

    Args:
        limits: The fastest that each wheel can turn, m/s, not negative; ``math.inf`` for no limit.

    Returns:
        The speeds, and the factor in 0..1 by which they were scaled.

    Raises:
        ValueError: Not one limit for each speed.
    """
    scale = 1.0
    for speed, limit in zip(speeds, limits, strict=True):
        if not math.isfinite(speed):
            return (0.0,) * len(speeds), 0.0
        if abs(speed) > limit:
            scale = min(scale, limit / abs(speed))
    if scale == 1.0:
        return tuple(speeds), 1.0
    # Rounding can make the product exceed the limit by its last bit, so clamp it.
    pairs = zip(speeds, limits, strict=True)
    return tuple([max(-limit, min(limit, speed * scale)) for speed, limit in pairs]), scale


def desaturate_twist(
    kinematics: Kinematics, twist: Twist2d, limits: Sequence[float]
) -> tuple[Twist2d, float]:
    """The fastest twist of the same curvature that the wheels can follow.

    Limit the wish before it is ramped: otherwise the ramp ends beyond the wheels' abilities, and a
    later slow-down has no effect at first.
    """
    _, scale = desaturate(wheel_speeds(kinematics, twist), limits)
    if scale == 1.0:
        return twist, 1.0
    if scale == 0.0:
        return Twist2d(), 0.0
    return Twist2d(vx=twist.vx * scale, vy=twist.vy * scale, wz=twist.wz * scale), scale


def _two_sides(name: str, separation_m: float) -> Kinematics:
    _positive("wheel_separation_m", separation_m)
    half = separation_m / 2.0
    return Kinematics(
        name=name,
        wheels=("left", "right"),
        inverse=((1.0, 0.0, -half), (1.0, 0.0, half)),
        forward=((0.5, 0.5), (0.0, 0.0), (-1.0 / separation_m, 1.0 / separation_m)),
    )


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ConfigError(f"chassis.{name} is {value}, which is not above 0.")
