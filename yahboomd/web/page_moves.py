"""The move of the page in control: `yahboomd moves` drives it while a place of the map is held.

:class:`~yahboomd.web.page_commands.PageCommands` decides who may hold, and for how long. Each
message of a page that holds becomes one beat of the move; none is made here.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from typing import Any, Protocol

from yahboomd.client.move_messages import Move, MoveSample
from yahboomd.client.robot_moves import Asking, MoveEnded, MoveRun
from yahboomd.core.errors import YahboomdError
from yahboomd.core.messages.native import PoseSample
from yahboomd.web.page_commands import PageRefusal
from yahboomd.web.page_session import Go, part
from yahboomd.web.robot_feed import LABEL

SPEED_M_S, TURN_RAD_S = 0.3, 1.5
"""The largest speeds: the defaults of a move without limits."""

NO_MOVES = PageRefusal(
    why="no_moves",
    text="The robot cannot go to places, because `yahboomd moves` does not run there.",
)
NO_POSE = "No pose came yet, so nothing was driven."
LET_GO = "You let go: the robot stops."


class MovingRobot(Asking, Protocol):
    """The methods of a robot that a page's move needs."""

    @property
    def pose(self) -> PoseSample | None: ...

    @property
    def source(self) -> str: ...

    @property
    def driver(self) -> str | None: ...


class PageMoves:
    """At most one move, and its state for pages.

    Args:
        changed: Called when that state has changed.
    """

    def __init__(self, robot: MovingRobot, changed: Callable[[], None]) -> None:
        self._robot = robot
        self._changed = changed
        self._aim: Go | None = None
        self._begun = False
        self._run: MoveRun | None = None
        self._task: asyncio.Task[None] | None = None
        self._seen: dict[str, Any] = {"state": "none"}

    def shown(self) -> bytes:
        """The move as pages show it."""
        return part("move", **self._seen)

    def hold(self, aim: Go) -> None:
        """The page holds: begin its move, or keep it alive. The goal stays the first one."""
        if self._aim is None:
            self._aim, self._begun = aim, False
            self._see(state="begins", x=aim.x, y=aim.y, turn=aim.turn)
        # Zeros of the joystick hold control for a moment, and would end the move.
        if not self._begun and self._robot.driver != self._robot.source:
            self._begun = True
            driving = self._drive(self._aim, self._task)
            self._task = asyncio.create_task(driving, name="web-move")
        elif self._run is not None and not self._run.is_over:
            self._run.beat()

    def let_go(self) -> None:
        """The page let go: end its move."""
        if self._aim is None:
            return
        self._aim = self._run = None
        if self._task is not None:
            self._task.cancel()
        if self._seen["state"] != "ended":
            self._end("let_go", LET_GO)

    async def close(self) -> None:
        """End it, and wait until the service was asked to end it."""
        self.let_go()
        if self._task is not None:
            await asyncio.wait([self._task])

    async def _drive(self, aim: Go, before: asyncio.Task[None] | None) -> None:
        if before is not None:
            await asyncio.wait([before])
        pose = self._robot.pose
        if pose is None:
            self._end("refused", NO_POSE)
            return
        run = MoveRun(self._robot, [move_to(aim, pose)], by=LABEL, beats=False)
        try:
            async with run:
                self._run = run
                async for sample in run:
                    self._follow(sample)
                await run.finished()
        except MoveEnded as ended:
            self._end(ended.reason, str(ended))
        except YahboomdError as error:
            self._end("refused", str(error))

    def _follow(self, sample: MoveSample) -> None:
        if self._aim is None:
            return
        names = ("state", "done", "left_m", "left_rad", "left_s", "reason", "message")
        self._see(**{name: getattr(sample, name) for name in names})

    def _end(self, reason: str, message: str) -> None:
        self._see(state="ended", reason=reason, message=message)

    def _see(self, **fields: object) -> None:
        self._seen = ({} if fields["state"] == "begins" else self._seen) | fields
        self._changed()


def move_to(aim: Go, pose: PoseSample) -> Move:
    """The move from a pose to a place, or the turn towards it."""
    speed, turn = min(aim.speed_m_s, SPEED_M_S), min(aim.turn_rad_s, TURN_RAD_S)
    if not aim.turn:
        return Move(kind="go_to", x=aim.x, y=aim.y, speed_m_s=speed, turn_rad_s=turn)
    angle = math.atan2(aim.y - pose.y, aim.x - pose.x) - pose.theta
    return Move(
        kind="turn",
        angle_rad=math.atan2(math.sin(angle), math.cos(angle)),
        speed_m_s=speed,
        turn_rad_s=turn,
    )
