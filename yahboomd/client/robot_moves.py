"""The moves of a robot by name: straight, turn, arc, go_to, follow."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence

from yahboomd.client.commanding import number
from yahboomd.client.move_messages import Move, MoveSample
from yahboomd.client.move_run import MoveRun, driven, with_limits


class RobotMoves(ABC):
    """Moves to a goal. Each waits until it is reached, and raises ``MoveEnded`` if it is not.

    Every move takes limits of its own: ``speed_m_s``, ``turn_rad_s``, ``acceleration_m_s2``,
    ``acceleration_rad_s2``, ``jerk_m_s3`` and ``jerk_rad_s3``; ``follow`` and ``go_to`` also
    ``look_ahead_m`` and ``corner_m``. None of them exceeds the robot's configured limits.
    `yahboomd moves` has to run.
    """

    @abstractmethod
    def moves(self, *moves: Move, uncertain_m: float | None = None) -> MoveRun:
        """Several moves, to be entered: ``async with robot.moves(...) as run:``."""

    async def straight(
        self, /, distance_m: float, *, left_m: float = 0.0, **limits: float
    ) -> MoveSample:
        """Drive straight by metres; negative: backward.

        Args:
            distance_m: Ahead.
            left_m: To the left, on mecanum wheels.

        Raises:
            MoveEnded: It ended before its goal.
            Refused: It is not driven; the message has the reason.
            NoDaemon: No `yahboomd moves` answers.
        """
        move = Move(
            kind="straight",
            distance_m=number("distance_m", distance_m),
            left_m=number("left_m", left_m),
        )
        return await self._driven(move, limits)

    async def turn(
        self, /, radians: float | None = None, *, degrees: float | None = None, **limits: float
    ) -> MoveSample:
        """Turn in place, positive to the left; raises as :meth:`straight` does.

        Args:
            radians: By how much; or ``degrees``.
        """
        return await self._driven(Move(kind="turn", angle_rad=_angle(radians, degrees)), limits)

    async def arc(
        self,
        /,
        radius_m: float,
        radians: float | None = None,
        *,
        degrees: float | None = None,
        backward: bool = False,
        **limits: float,
    ) -> MoveSample:
        """Drive along an arc; raises as :meth:`straight` does.

        Args:
            radius_m: Of the way of the base's middle.
            radians: By how much the base turns, positive to the left; or ``degrees``.
            backward: Drive it backward.
        """
        move = Move(
            kind="arc",
            radius_m=number("radius_m", radius_m),
            angle_rad=_angle(radians, degrees),
            backward=backward,
        )
        return await self._driven(move, limits)

    async def go_to(
        self,
        /,
        x: float,
        y: float,
        theta: float | None = None,
        *,
        backward: bool = False,
        **limits: float,
    ) -> MoveSample:
        """Go to a place of the odometry frame; raises as :meth:`straight` does.

        Args:
            x: Metres.
            y: Metres.
            theta: The heading there, in radians; None: any.
            backward: Drive backward if that needs less turning.
        """
        move = Move(
            kind="go_to",
            x=number("x", x),
            y=number("y", y),
            theta=None if theta is None else number("theta", theta),
            backward=backward,
        )
        return await self._driven(move, limits)

    async def follow(
        self, /, points: Iterable[Sequence[float]], *, backward: bool = False, **limits: float
    ) -> MoveSample:
        """Follow a path; raises as :meth:`straight` does.

        Args:
            points: (x, y) or (x, y, theta) in metres and radians, in the odometry frame.
            backward: Drive backward if that needs less turning.
        """
        read = tuple(tuple(number("a point", each) for each in point) for point in points)
        if any(len(point) not in {2, 3} for point in read):
            raise ValueError("A point is (x, y) or (x, y, theta).")
        return await self._driven(Move(kind="follow", points=read, backward=backward), limits)

    async def _driven(self, move: Move, limits: dict[str, float]) -> MoveSample:
        return await driven(self.moves(with_limits(move, limits)))


def _angle(radians: float | None, degrees: float | None) -> float:
    if (radians is None) == (degrees is None):
        raise TypeError("Give the angle in radians, or as degrees=90.")
    if degrees is not None:
        return math.radians(number("degrees", degrees))
    return number("radians", radians)
