"""Who of a fleet acknowledged a stop, who stands, and who is missing. Pure: it asks nobody."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import msgspec

from yahboomd.core.messages.native import ServiceReply
from yahboomd.core.program import plain
from yahboomd.core.standstill import STANDING_M_S

STAND_WITHIN_S = 3.0
"""Wheels that still turn this long after the acknowledgement are reported as turning."""

_NAMED = 6
"""The most robots that one line of progress names."""


class RobotStop(msgspec.Struct, kw_only=True):
    """One robot's part of a stop.

    Attributes:
        acknowledged_s: When it acknowledged that the stop was sent to its board; None if not yet.
        stands: Whether its counts show standing wheels; None if they show nothing.
        fastest_m_s: Its fastest wheel by its latest counts.
        slow: The number of the latest counts that showed standing wheels.
        refusal: Its reason if it answered and could not send the stop.
        present: Whether its daemon is there, by its token.
        left: Whether its daemon was there, and is not any more.
    """

    acknowledged_s: float | None = None
    stands: bool | None = None
    fastest_m_s: float | None = None
    slow: int | None = None
    refusal: str = ""
    present: bool = False
    left: bool = False


class FleetStop:
    """Collects the answers of a stop of many robots.

    Args:
        robots: The namespaces of the known robots.
    """

    def __init__(self, robots: Iterable[str]) -> None:
        self.robots = {robot: RobotStop() for robot in robots}

    def answered(self, robot: str, reply: ServiceReply, now_s: float) -> None:
        """Note an answer; a robot that was not known is from now on.

        Args:
            now_s: Seconds since the stop began.
        """
        found = self.robots.setdefault(robot, RobotStop())
        found.present = True
        if not reply.success:
            found.refusal = plain(reply.message)
            return
        found.refusal = ""
        if found.acknowledged_s is None:
            found.acknowledged_s = now_s
        stands: object = reply.data.get("stands")
        fastest_m_s = reply.data.get("fastest_m_s")
        if not found.stands:
            # An answer tells how far its own stop was obeyed: a second one begins anew.
            found.stands = stands if isinstance(stands, bool) else None
            known = isinstance(fastest_m_s, int | float)
            found.fastest_m_s = fastest_m_s if known else None

    def measured(self, robot: str, seq: int, speeds_m_s: Sequence[float]) -> None:
        """Note the speeds of a robot's wheels; two readings in a row below the limit are a stand.

        Args:
            seq: The number of the reading.
        """
        found = self.robots[robot]
        if found.acknowledged_s is None or not speeds_m_s:
            return
        found.fastest_m_s = max(map(abs, speeds_m_s))
        if found.fastest_m_s >= STANDING_M_S:
            found.slow = None
        elif found.slow is None:
            found.slow = seq
        elif found.slow != seq:
            found.stands = True

    def seen(self, robot: str, *, present: bool) -> bool:
        """Note that a robot's daemon came or went.

        Returns:
            Whether the stop has to be sent to it at once: it came, and has not acknowledged. One
            that left may end, or begin anew: nothing is known of it until it acknowledges again.
        """
        found = self.robots.setdefault(robot, RobotStop())
        if found.present and not present:
            found.acknowledged_s = found.stands = found.slow = None
        found.left = not present and (found.left or found.present)
        came, found.present = present and not found.present, present
        return came and found.acknowledged_s is None

    def again(self) -> None:
        """Have every robot acknowledge anew: the stop is asked for once more."""
        for robot in self.robots.values():
            robot.acknowledged_s = robot.stands = robot.slow = None
            robot.refusal = ""

    @property
    def missing(self) -> list[str]:
        """The robots that have not acknowledged."""
        return [name for name, robot in self.robots.items() if robot.acknowledged_s is None]

    def turning(self, now_s: float) -> list[str]:
        """The robots whose wheels may still come to rest; ask for their speeds."""
        return [
            name
            for name, robot in self.robots.items()
            if robot.acknowledged_s is not None
            and not robot.stands
            and now_s - robot.acknowledged_s < STAND_WITHIN_S
        ]

    def is_over(self, now_s: float) -> bool:
        """Whether all acknowledged, and stand or had the time for it; never if none is known."""
        return bool(self.robots) and not self.missing and not self.turning(now_s)

    @property
    def all_stand(self) -> bool:
        """Whether every robot acknowledged and stands; of no robots none does."""
        return (
            bool(self.robots)
            and not self.missing
            and all(robot.stands for robot in self.robots.values())
        )

    def progress(self) -> str:
        """How many acknowledged, and the names of some that did not."""
        missing, count = self.missing, len(self.robots)
        words = f"{count - len(missing)} of {count} robots acknowledged."
        if missing:
            more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
            words += f" Missing: {', '.join(missing[:_NAMED])}{more}."
        return words

    def report(self) -> list[str]:
        """The result, a line for the whole and one for each robot that does not stand."""
        times = [each.acknowledged_s for each in self.robots.values()]
        latest_s = max((each for each in times if each is not None), default=None)
        count, missing = len(self.robots), len(self.missing)
        last = "" if latest_s is None else f", the last after {latest_s:.2f} s"
        stand = sum(1 for robot in self.robots.values() if _stands(robot))
        first = f"{count - missing} of {count} robots acknowledged{last}; {stand} stand."
        return [
            first,
            *(f"{name}: {_words(each)}" for name, each in self.robots.items() if not _stands(each)),
        ]


def _stands(robot: RobotStop) -> bool:
    return robot.acknowledged_s is not None and robot.stands is True


def _words(robot: RobotStop) -> str:
    if robot.acknowledged_s is None:
        if robot.refusal:
            return f"it answered and was not stopped. {robot.refusal}"
        if robot.present:
            return "did not answer, although its daemon is there."
        if robot.left:
            return "left during the stop: whether it stands is unknown."
        return "is not reachable."
    if robot.stands is None:
        return "stopped; no counts show whether its wheels stand."
    speed = "" if robot.fastest_m_s is None else f" at {robot.fastest_m_s:.2f} m/s"
    return f"stopped; its wheels still turned{speed} by its latest counts."
