"""The shortest ways of a car from pose to pose: arcs of one radius, and a straight or a third arc.

The six words of Dubins (*On curves of minimal length*, 1957), by the closed forms of Shkel and
Lumelsky (*Classification of the Dubins set*, 2001).
"""

from __future__ import annotations

import math

from yahboomd.core.model import Pose2d

HEADINGS = 180
"""The number of headings compared for a goal that allows any heading."""

Pieces = list[tuple[float, float]]


def shortest(begin: Pose2d, goal: Pose2d, radius_m: float) -> Pieces:
    """Length and curvature of each piece of the shortest way."""
    dx, dy = goal.x - begin.x, goal.y - begin.y
    distance = math.hypot(dx, dy) / radius_m
    bearing = math.atan2(dy, dx) if distance else 0.0
    alpha = _turn(begin.theta - bearing)
    beta = _turn(goal.theta - bearing)
    best: tuple[float, str, tuple[float, float, float]] | None = None
    for word, lengths in _words(distance, alpha, beta):
        total = sum(lengths)
        if best is None or total < best[0]:
            best = total, word, lengths
    assert best is not None
    curvature = {"L": 1.0 / radius_m, "S": 0.0, "R": -1.0 / radius_m}
    return [
        (length * radius_m, curvature[letter])
        for letter, length in zip(best[1], best[2], strict=True)
        if length * radius_m > 1e-6
    ]


def to_point(begin: Pose2d, x: float, y: float, radius_m: float) -> Pieces:
    """The shortest way to a point, with any heading there."""
    ways = (
        shortest(begin, Pose2d(x=x, y=y, theta=2.0 * math.pi * index / HEADINGS), radius_m)
        for index in range(HEADINGS)
    )
    return min(ways, key=lambda way: sum(length for length, _ in way))


def _words(d: float, alpha: float, beta: float) -> list[tuple[str, tuple[float, float, float]]]:
    sa, sb, ca, cb = math.sin(alpha), math.sin(beta), math.cos(alpha), math.cos(beta)
    difference = math.cos(alpha - beta)
    found: list[tuple[str, tuple[float, float, float]]] = []

    square = 2.0 + d * d - 2.0 * difference + 2.0 * d * (sa - sb)
    if square >= 0.0:
        angle = math.atan2(cb - ca, d + sa - sb)
        found.append(("LSL", (_turn(angle - alpha), math.sqrt(square), _turn(beta - angle))))
    square = 2.0 + d * d - 2.0 * difference + 2.0 * d * (sb - sa)
    if square >= 0.0:
        angle = math.atan2(ca - cb, d - sa + sb)
        found.append(("RSR", (_turn(alpha - angle), math.sqrt(square), _turn(angle - beta))))
    square = -2.0 + d * d + 2.0 * difference + 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        angle = math.atan2(-ca - cb, d + sa + sb) - math.atan2(-2.0, p)
        found.append(("LSR", (_turn(angle - alpha), p, _turn(angle - beta))))
    square = -2.0 + d * d + 2.0 * difference - 2.0 * d * (sa + sb)
    if square >= 0.0:
        p = math.sqrt(square)
        angle = math.atan2(ca + cb, d - sa - sb) - math.atan2(2.0, p)
        found.append(("RSL", (_turn(alpha - angle), p, _turn(beta - angle))))
    cosine = (6.0 - d * d + 2.0 * difference + 2.0 * d * (sa - sb)) / 8.0
    if abs(cosine) <= 1.0:
        p = _turn(2.0 * math.pi - math.acos(cosine))
        t = _turn(alpha - math.atan2(ca - cb, d - sa + sb) + p / 2.0)
        found.append(("RLR", (t, p, _turn(alpha - beta - t + p))))
    cosine = (6.0 - d * d + 2.0 * difference + 2.0 * d * (sb - sa)) / 8.0
    if abs(cosine) <= 1.0:
        p = _turn(2.0 * math.pi - math.acos(cosine))
        t = _turn(-alpha - math.atan2(ca - cb, d + sa - sb) + p / 2.0)
        found.append(("LRL", (t, p, _turn(beta - alpha - t + p))))
    return found


def _turn(angle: float) -> float:
    turned = angle % (2.0 * math.pi)
    # Rounding may give 2 pi instead of 0.
    return 0.0 if 2.0 * math.pi - turned < 1e-9 else turned
