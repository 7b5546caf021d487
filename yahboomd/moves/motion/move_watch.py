"""Checks whether a commanded base moves, and whether its pose is plausible."""

from __future__ import annotations

import math
from collections.abc import Sequence

from yahboomd.client.move_messages import Reason
from yahboomd.core.model import Pose2d, Twist2d

BLOCKED_S, STICKS_S = 2.0, 2.0
"""A base that hardly moves although it was commanded a way for the first time is blocked, if that
lasts for the second: a board's own loop takes up to 2.3 s to wind up to wheels that stick."""

STARTS_S = 0.5
"""Commands of this last part of it are not counted: a motor with a lag of 0.3 s begins slowly."""

LEAST_WAY_M = 0.015
"""The least commanded way, less than that of the slowest end of a leg; a turn counts as the way of
a wheel at `ARM_M`."""

ARM_M = 0.1
SHARE = 0.2

JUMP_M = 0.1
JUMP_RAD = 0.35
"""The excess of the pose's step over the command that shows that it was set, or a gap bridged."""

SLIP_S = 0.6
SLIP_RAD = 0.12
SLIP_SHARE = 0.5

EXCHANGED = (
    "By its wheels the base turns to the {}, and by the gyro to the {}: the plugs of a left and a "
    "right motor may be exchanged. Compare them with the configuration, or run `yahboomd setup`; "
    "if the plugs fit, imu.axes does not."
)


class MoveWatch:
    """Watches one list of moves. All times are in monotonic nanoseconds.

    Args:
        steers: The base is a car: how far its steering is behind its command is no slip.
    """

    def __init__(self, *, steers: bool = False) -> None:
        self._steers = steers
        self._seen: list[tuple[int, Pose2d, float]] = []
        self._commanded = 0.0
        self._stuck_ns: int | None = None
        self._twist = Twist2d()
        self._variance: float | None = None
        self._turns: list[tuple[int, float, float]] = []

    def command(self, twist: Twist2d) -> None:
        """The velocity that is commanded from now on."""
        self._twist = twist

    def jumped(self, pose: Pose2d, now_ns: int) -> bool:
        """Whether the pose made a step that the wheels did not drive."""
        if not self._seen:
            return False
        at_ns, before, _ = self._seen[-1]
        since_s = min(0.5, (now_ns - at_ns) / 1e9)
        twist = self._twist
        way_m = (math.hypot(twist.vx, twist.vy) + 0.3) * since_s * 2.0
        turn_rad = (abs(twist.wz) + 1.0) * since_s * 2.0
        return (
            math.hypot(pose.x - before.x, pose.y - before.y) > JUMP_M + way_m
            or abs(pose.theta - before.theta) > JUMP_RAD + turn_rad
        )

    def blocked(self, pose: Pose2d, now_ns: int) -> bool:
        """Whether the base has not obeyed for a while; call it with every pose."""
        if self._seen:
            since_s = (now_ns - self._seen[-1][0]) / 1e9
            twist = self._twist
            self._commanded += since_s * (math.hypot(twist.vx, twist.vy) + ARM_M * abs(twist.wz))
        self._seen.append((now_ns, pose, self._commanded))
        while now_ns - self._seen[1][0] > BLOCKED_S * 1e9 if len(self._seen) > 1 else False:
            self._seen.pop(0)
        at_ns, begin, commanded = self._seen[0]
        if now_ns - at_ns < BLOCKED_S * 1e9:
            return False
        # A base that is slow to start has not obeyed the newest commands yet.
        wanted = max(way for ns, _, way in self._seen if now_ns - ns >= STARTS_S * 1e9) - commanded
        # The largest distance: a turn to the left and one to the right end at their begin.
        if wanted <= LEAST_WAY_M or SHARE * wanted <= max(
            math.hypot(each.x - begin.x, each.y - begin.y) + ARM_M * abs(each.theta - begin.theta)
            for _, each, _ in self._seen
        ):
            self._stuck_ns = None
            return False
        if self._stuck_ns is None:
            self._stuck_ns = now_ns
        return now_ns - self._stuck_ns >= STICKS_S * 1e9

    def disagree(
        self, wheels_rad_s: float, gyro_rad_s: float, now_ns: int
    ) -> tuple[Reason, str] | None:
        """How wheels and gyro disagree on a turn, if they do; call it with every gyro sample.

        Args:
            wheels_rad_s: The turning speed by the counts.
            gyro_rad_s: The same by the gyro, without its bias.
        """
        if self._steers:
            return None
        wheels = gyro = 0.0
        if self._turns:
            since_s = min(0.1, (now_ns - self._turns[-1][0]) / 1e9)
            wheels = self._turns[-1][1] + wheels_rad_s * since_s
            gyro = self._turns[-1][2] + gyro_rad_s * since_s
        self._turns.append((now_ns, wheels, gyro))
        while len(self._turns) > 1 and now_ns - self._turns[1][0] > SLIP_S * 1e9:
            self._turns.pop(0)
        by_wheels, by_gyro = wheels - self._turns[0][1], gyro - self._turns[0][2]
        if abs(by_wheels) <= SLIP_RAD or abs(by_wheels - by_gyro) <= SLIP_SHARE * abs(by_wheels):
            return None
        if by_gyro * by_wheels < 0.0 and abs(by_gyro) > SLIP_SHARE * abs(by_wheels):
            sides = ("left", "right") if by_wheels > 0.0 else ("right", "left")
            return "exchanged", EXCHANGED.format(*sides)
        return "slipping", "The wheels turn, and the gyro does not see the base turn."

    def uncertain(self, covariance: Sequence[float], most_m: float) -> bool:
        """Whether the place became more uncertain than ``most_m`` since the moves began.

        Args:
            covariance: The pose's covariance, over (x, y, theta), row by row.
            most_m: Standard deviation in metres.
        """
        variance = max(covariance[0], covariance[4])
        if self._variance is None:
            self._variance = variance
        return variance - self._variance > most_m * most_m
