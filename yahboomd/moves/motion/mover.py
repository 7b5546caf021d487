"""Drives a list of moves: a velocity for each pose, until they are over."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from yahboomd.client.move_messages import Move, Reason
from yahboomd.core.model import NS_PER_S, STANDSTILL, Pose2d, Twist2d
from yahboomd.moves.motion.base_limits import Base
from yahboomd.moves.motion.lag_model import LagModel
from yahboomd.moves.motion.leg import MoveLeg
from yahboomd.moves.motion.move_plan import PlannedLeg, plan
from yahboomd.moves.motion.move_watch import MoveWatch

STEP_NS = 20_000_000
"""The least time between two velocities, even if poses come more often."""

LONGEST_STEP_S = 0.1

DRIVEN_M, DRIVEN_RAD = 0.05, math.radians(20.0)
CORRECTS_M, CORRECTS_RAD = 0.25, math.radians(60.0)
"""A leg from this length on is passed while the base rolls on, if the next one is as long as this:
a way corrects a heading, and a turn the place along its first heading."""

OFF_M, OFF_RAD = 0.01, math.radians(3.0)
"""A base that stands farther from a place, or turned by more from its heading, did not reach it."""

LEAST_M = 0.005
"""Shorter ways are not told."""

LATE_NS = 60_000_000
"""A correction lasts until the next pose. Of simulated moves whose poses came this late on average,
1 of 96 ended short (docs/moves.md)."""


class MoveProgress(msgspec.Struct, frozen=True, kw_only=True):
    """The progress of a list of moves.

    Attributes:
        index: The number of the present move.
        kind: The kind of the present move.
        done: The share of all moves, by their ideal times.
        left_m: The remaining way.
        left_rad: The remaining turns in place.
        left_s: The remaining time, by the ideal profiles.
    """

    index: int
    kind: str
    done: float
    left_m: float
    left_rad: float
    left_s: float


class MoveEnd(msgspec.Struct, frozen=True, kw_only=True):
    """The end of a list of moves: one of the documented reasons, and a sentence."""

    reason: Reason
    message: str


class Mover:
    """One list of moves being driven.

    Args:
        moves: At least one.
        begin: The pose at their begin.
        base: The abilities of the base.
        lag: The model of the base, kept from moves before.

    Raises:
        MoveRefused: The base cannot drive them.
    """

    def __init__(self, moves: Sequence[Move], begin: Pose2d, base: Base, lag: LagModel) -> None:
        self.ended: MoveEnd | None = None
        self.watch = MoveWatch(steers=not base.turns)
        self._moves = moves
        self._begin = begin
        self._base = base
        self._amends = -1
        self._legs: list[PlannedLeg] = plan(moves, begin, base)
        self._times = [leg.time_s for leg in self._legs]
        self._lag = lag
        lag.slowest[:] = base.slowest
        self._number = 0
        self._leg: MoveLeg | None = None
        self._paused = False
        self._twist = STANDSTILL
        self._advanced_ns: int | None = None
        self._stepped_ns: int | None = None
        self._apart_ns = 0
        self._pose = begin
        lag.forget_pose()

    @property
    def paused(self) -> bool:
        """Whether it stands, or comes to rest, until it is resumed."""
        return self._paused

    def pause(self) -> None:
        """Come to rest on the way."""
        self._paused = True

    def resume(self) -> None:
        """Continue."""
        self._paused = False

    def end(self, reason: Reason, message: str) -> None:
        """End it; only the first end counts."""
        if self.ended is None:
            self.ended = MoveEnd(reason=reason, message=message)
            self._lag.command(STANDSTILL)

    def step(self, pose: Pose2d, now_ns: int) -> Twist2d | None:
        """Take a new pose.

        Returns:
            The velocity to command now; None to leave the command as it is, or once it is over.
        """
        if self.ended is not None:
            return None
        if self._advanced_ns is not None:
            self._lag.advance((now_ns - self._advanced_ns) / NS_PER_S)
        self._advanced_ns = now_ns
        if self.watch.jumped(pose, now_ns):
            self.end("pose_changed", "The pose made a step: it was set, or a gap was bridged.")
            return None
        self._lag.seen(pose)
        self._pose = pose
        if self.watch.blocked(pose, now_ns):
            self.end("blocked", self._blocked())
            return None
        if self._stepped_ns is not None and now_ns - self._stepped_ns < STEP_NS * 0.9:
            return None
        since_s = STEP_NS / NS_PER_S
        if self._stepped_ns is not None:
            since_s = min(LONGEST_STEP_S, (now_ns - self._stepped_ns) / NS_PER_S)
            lands = self._leg is not None and self._leg.lands
            self._apart_ns = max(self._apart_ns, now_ns - self._stepped_ns) if lands else 0
        self._stepped_ns = now_ns
        twist = self._next(pose, since_s)
        if twist is not None:
            self._twist = twist
            self._lag.command(twist)
            # Pulses of a landing may move nothing: they are counted by the landing.
            lands = self._leg is not None and self._leg.lands
            self.watch.command(STANDSTILL if lands else twist)
        return twist

    def _next(self, pose: Pose2d, dt_s: float) -> Twist2d | None:
        while self._number < len(self._legs):
            if self._leg is None:
                self._leg = self._legs[self._number].drive(self._lag, last=self._is_last)
            twist = self._leg.step(pose, dt_s, hold=self._paused)
            room = self._room
            passes = room is not None and not self._paused and self._leg.is_near(pose, room)
            if twist is not None and not passes:
                return twist
            if not passes and self._is_last:
                if short_by := self._short_by(self._leg, pose):
                    self._end_short(short_by)
                    return None
                self._amend(pose)
            self._leg = None
            self._number += 1
        self.end("reached", f"The goal is reached: {way_words(self._begin, pose)}.")
        return None

    def _amend(self, pose: Pose2d) -> None:
        """Turn back to the heading of a way's end, then drive what that turn moved the base.

        Wheels that stick bend a base at the begin and the end of its way.
        """
        here = self._legs[self._number]
        if not self._base.turns or self._moves[here.move].kind not in {"straight", "arc"}:
            return
        end, legs = here.end, list[PlannedLeg]()
        if self._amends != here.move:
            if abs(self._turned_off(pose)) <= OFF_RAD:
                return
            self._amends = here.move
            legs = [msgspec.structs.replace(here, course=None, headings=(), begin=pose)]
            legs[0] = msgspec.structs.replace(legs[0], limits=here.turn)
        elif here.course is None:
            way = math.cos(end.theta) * (end.x - pose.x) + math.sin(end.theta) * (end.y - pose.y)
            if abs(way) > OFF_M / 2.0:
                begin = msgspec.structs.replace(pose, theta=end.theta)
                (leg,) = plan([Move(kind="straight", distance_m=way)], begin, self._base)
                legs = [msgspec.structs.replace(leg, move=here.move)]
        self._legs[self._number + 1 : self._number + 1] = legs
        self._times[self._number + 1 : self._number + 1] = [leg.time_s for leg in legs]

    def _turned_off(self, pose: Pose2d) -> float:
        """How far to the left of its goal's heading it is turned; 0 where no heading was asked."""
        here = self._legs[self._number]
        move = self._moves[here.move]
        asked = move.theta is not None or any(len(point) == 3 for point in move.points[-1:])
        if (move.kind in {"go_to", "follow"} and not asked) or self._room is not None:
            return 0.0
        return math.remainder(pose.theta - here.end.theta, math.tau)

    def _blocked(self) -> str:
        here = self._legs[self._number]
        speed = (
            self._twist.wz if here.course is None else math.hypot(self._twist.vx, self._twist.vy)
        )
        turns, unit = ("turn", "rad/s") if here.course is None else ("drive", "m/s")
        return (
            f"The base does not {turns} although {abs(speed):.2f} {unit} are commanded. Look for "
            "an obstacle; on a carpet or with a low battery, ask for a larger speed."
        )

    @property
    def _is_last(self) -> bool:
        """Whether the base has to stand at the end of this leg.

        Also before a leg of another kind: a turn in place has to begin at the end of the way.
        """
        if self._number + 1 >= len(self._legs):
            return True
        here, after = self._legs[self._number], self._legs[self._number + 1]
        return here.move != after.move or (here.course is not None) != (after.course is not None)

    @property
    def _room(self) -> float | None:
        """How much of this leg's rest the next one can correct, from 0 to 1.

        None if that is another move's: it begins where this one has to end.
        """
        if self._number + 1 >= len(self._legs):
            return None
        here, after = self._legs[self._number], self._legs[self._number + 1]
        if here.move != after.move:
            return None
        of_here = here.length / (DRIVEN_M if here.course else DRIVEN_RAD)
        of_after = after.length / (CORRECTS_M if after.course else CORRECTS_RAD)
        return min(1.0, of_here, of_after)

    def _short_by(self, leg: MoveLeg, pose: Pose2d) -> str:
        """How far from its end a leg ended, and why; empty if near enough."""
        here = self._legs[self._number]
        kind = self._moves[here.move].kind
        amended = self._amends == here.move
        # What a turn back and the way after it leave is judged below.
        short_by = "" if amended else leg.short_by(pose)
        off = math.hypot(pose.x - here.end.x, pose.y - here.end.y)
        # A turn does not watch its place, nor a course the distance to its side.
        is_off = kind in {"go_to", "follow"} and self._room is None and off > OFF_M
        if is_off and not short_by:
            short_by = f"{1000.0 * off:.1f} mm"
            if kind == "follow":
                return (
                    f"{short_by} from its goal, beside the end of its path. Look for points that "
                    "are nearer than 20 mm to each other, or a long look_ahead_m."
                )
        turned = self._turned_off(pose)
        if not short_by and amended and off > 2.0 * OFF_M:
            short_by = f"{1000.0 * off:.1f} mm"
        if abs(turned) > OFF_RAD and (short_by or amended or not self._base.turns):
            place = f"{short_by} and " if short_by and kind != "turn" else ""
            short_by = f"{place}turned {degrees_words(turned)}"
        return short_by and f"{short_by} from its goal, and small commands do not move it there."

    def _end_short(self, short_by: str) -> None:
        late = ""
        if self._apart_ns >= LATE_NS:
            late = (
                f" Poses came up to {self._apart_ns / NS_PER_S:.2f} s apart meanwhile: the machine "
                "or the network is too busy for small corrections."
            )
        self.end("short", f"The base stands {short_by}{late}")

    @property
    def progress(self) -> MoveProgress:
        """How far it is."""
        if not self._legs or self._number >= len(self._legs):
            last = len(self._moves) - 1
            return MoveProgress(
                index=last,
                kind=self._moves[last].kind,
                done=1.0,
                left_m=0.0,
                left_rad=0.0,
                left_s=0.0,
            )
        now = self._legs[self._number]
        left = now.length if self._leg is None else max(0.0, self._leg.left(self._pose))
        left = min(left, now.length)
        left_s = self._times[self._number] * (left / now.length if now.length else 0.0)
        left_m = left if now.course else 0.0
        left_rad = 0.0 if now.course else left
        for leg, time_s in zip(
            self._legs[self._number + 1 :], self._times[self._number + 1 :], strict=True
        ):
            left_s += time_s
            left_m += leg.length if leg.course else 0.0
            left_rad += 0.0 if leg.course else leg.length
        total_s = sum(self._times)
        return MoveProgress(
            index=now.move,
            kind=self._moves[now.move].kind,
            done=min(1.0, max(0.0, 1.0 - left_s / total_s)) if total_s else 1.0,
            left_m=left_m,
            left_rad=left_rad,
            left_s=left_s,
        )

    @property
    def time_s(self) -> float:
        """The time of all legs by their ideal profiles."""
        return sum(self._times)


def way_words(begin: Pose2d, end: Pose2d) -> str:
    """How far, and to which side, a base drove and turned."""
    dx, dy = end.x - begin.x, end.y - begin.y
    cosine, sine = math.cos(begin.theta), math.sin(begin.theta)
    ahead, left = cosine * dx + sine * dy, cosine * dy - sine * dx
    words = []
    if abs(ahead) >= LEAST_M:
        words.append(f"{abs(ahead):.3f} m {'ahead' if ahead > 0.0 else 'back'}")
    if abs(left) >= LEAST_M:
        words.append(f"{abs(left):.3f} m to the {'left' if left > 0.0 else 'right'}")
    words.append(f"turned {degrees_words(end.theta - begin.theta)}")
    return ", ".join(words)


def degrees_words(angle: float) -> str:
    """An angle with its side."""
    side = "left" if angle > 0.0 else "right"
    return f"{math.degrees(abs(angle)):.1f} degrees to the {side}"
