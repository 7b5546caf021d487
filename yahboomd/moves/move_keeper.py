"""Decides who may start moves, and when they end.

It has no bus and no clock: the service (:mod:`yahboomd.moves.move_service`) passes messages and
their times. A move needs its client. It ends when the client is gone, another source takes over,
the emergency stop is engaged, or the board, the daemon or the pose has a problem. No move restarts
by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from yahboomd.client.move_messages import (
    SILENCE_S,
    SOURCE,
    Move,
    MoveRequest,
    MoveSample,
    Reason,
)
from yahboomd.core.messages.native import (
    DRIVABLE,
    EventSample,
    ImuSample,
    PoseSample,
    ServiceReply,
    StatusSample,
    TwistSample,
)
from yahboomd.core.model import NS_PER_S, Pose2d, Twist2d
from yahboomd.core.names import source_words
from yahboomd.moves.motion.base_limits import Base, base_of
from yahboomd.moves.motion.lag_model import LagModel
from yahboomd.moves.motion.move_plan import MoveRefused
from yahboomd.moves.motion.mover import Mover

POSE_S = 0.5
"""Moves end without a pose for this time. The last velocity ends sooner."""

OBEYS_S = 1.5
"""The time within which the daemon has to give control to the moves."""

UNCERTAIN_M = 0.5

MOST_NAME = 32
"""Characters of a client's name that fit into the label of a stop."""

SOURCE_LINES = f"""\
[command.sources."{SOURCE}"]
priority = 5
timeout_s = 0.3
"""
"""The lines that a configuration with sources of its own needs."""

POSE_EVENTS = frozenset(
    {"pose_set", "odometry_bridged", "odometry_discontinuity", "board_reset", "no_counts"}
)
"""Events after which the moves' plan no longer fits the pose."""

NO_DAEMON = "No daemon is there: start it, or look at its log."


class Running(msgspec.Struct, kw_only=True):
    """Moves that are being driven.

    Attributes:
        beat_ns: The time of their client's latest beat; monotonic.
    """

    id: str
    by: str
    holder: str
    count: int
    uncertain_m: float
    mover: Mover
    begun_ns: int
    beat_ns: int
    commanded_ns: int | None = None


class MoveKeeper:
    """One robot's moves, one list at a time.

    Args:
        drive: Commands a velocity.
        stop: Commands a stop; it takes what to call it: who had asked, and the reason of the end.
        publish: Takes each sample of progress, without its stamp, and the end.
        name: Makes the id of moves.
    """

    def __init__(
        self,
        *,
        drive: Callable[[Twist2d], object],
        stop: Callable[[str], object],
        publish: Callable[[MoveSample], object],
        name: Callable[[], str],
    ) -> None:
        self.last: MoveSample | None = None
        self._drive = drive
        self._stop = stop
        self._publish = publish
        self._name = name
        self._lag = LagModel()
        self._running: Running | None = None
        self._base: Base | None = None
        self._refusal = NO_DAEMON
        self._status: StatusSample | None = None
        self._pose: PoseSample | None = None
        self._pose_ns = 0
        self._wheels_rad_s = 0.0

    # The daemon.

    @property
    def knows_base(self) -> bool:
        """Whether the configuration is known."""
        return self._base is not None

    def learn(self, config: Mapping[str, Any]) -> None:
        """Take the daemon's configuration."""
        try:
            self._base = base_of(config)
            sources = config["command"]["sources"]
        except (KeyError, TypeError, ValueError, ArithmeticError):
            self._refusal = "The daemon's configuration cannot be read: it is another version's."
            self._base = None
            return
        self._refusal = ""
        if SOURCE not in sources:
            self._refusal = (
                f"The daemon takes no commands on {SOURCE}: its configuration has sources of its "
                f"own. Add these lines to it and start it again:\n{SOURCE_LINES}"
            )

    def lost(self) -> None:
        """The daemon is gone."""
        self._base, self._refusal = None, NO_DAEMON
        self._status = self._pose = None
        self.end("daemon_lost", "The daemon is gone; its robot stops by itself.")

    # Clients.

    def start(self, request: MoveRequest, now_ns: int) -> ServiceReply:
        """Begin moves, or reply with the reason why not."""
        if why := self._why_not(now_ns):
            return ServiceReply(success=False, message=why)
        assert self._pose is not None
        assert self._base is not None
        if not (_finite(request) and all(_finite(move) for move in request.moves)):
            return ServiceReply(success=False, message="A number of the moves is not finite.")
        try:
            mover = Mover(request.moves, _pose(self._pose), self._base, self._lag)
        except MoveRefused as refused:
            return ServiceReply(success=False, message=str(refused))
        running = Running(
            id=self._name(),
            by=request.by or "",
            holder=request.holder or "",
            count=len(request.moves),
            uncertain_m=request.uncertain_m or UNCERTAIN_M,
            mover=mover,
            begun_ns=now_ns,
            beat_ns=now_ns,
        )
        self._running = running
        self.report()
        seconds = mover.time_s
        return ServiceReply(
            success=True,
            message=f"Moves {running.id} begin, for {seconds:.1f} s at least.",
            data={"id": running.id, "seconds": seconds},
        )

    def _why_not(self, now_ns: int) -> str:
        if self._refusal:
            return self._refusal
        status = self._status
        if status is None or self._pose is None or now_ns - self._pose_ns > POSE_S * NS_PER_S:
            return "No poses come from the daemon: is its board connected?"
        if status.state not in DRIVABLE:
            return f"The robot cannot drive. {status.why}"
        if self._running is not None:
            by = f" of {self._running.by}" if self._running.by else ""
            return f"Moves {self._running.id}{by} are being driven. Cancel them first."
        if status.driver not in {None, SOURCE} and status.state == "driving":
            return f"{source_words(status.driver)} drives the robot."
        return ""

    def beat(self, name: str, at_ns: int) -> None:
        """Note a beat of the moves' client."""
        if self._running is not None and name == self._running.id:
            self._running.beat_ns = max(self._running.beat_ns, at_ns)

    def beats_lost(self, at_ns: int) -> None:
        """Note that beats were lost in a flood: a client's token shows that it is there."""
        if self._running is not None and self._running.holder:
            self.beat(self._running.id, at_ns)

    def holder(self, name: str, *, present: bool) -> None:
        """The token of a client came or went."""
        running = self._running
        if running is not None and not present and name and name == running.holder:
            self.end("client_gone", "The client that asked for the moves is gone.")

    def choose(self, verb: str, name: str | None) -> ServiceReply:
        """Cancel, pause or resume moves."""
        running = self._running
        if running is None or (name is not None and name != running.id):
            which = "No moves are" if name is None else f"Moves {name} are not"
            return ServiceReply(success=False, message=f"{which} being driven.")
        if verb == "cancel":
            self.end("cancelled", "A client cancelled the moves.")
            return ServiceReply(success=True, message=f"Moves {running.id} are cancelled.")
        if verb == "pause":
            running.mover.pause()
            words = "pause: the robot comes to rest"
        else:
            running.mover.resume()
            words = "go on"
        self.report()
        return ServiceReply(success=True, message=f"Moves {running.id} {words}.")

    # Samples.

    def status(self, status: StatusSample, now_ns: int) -> None:
        """A status of the daemon."""
        self._status = status
        running = self._running
        if running is None:
            return
        if status.state == "estopped":
            self.end("estop", f"The emergency stop is engaged. {status.why}")
        elif status.state == "fault":
            self.end("fault", status.why)
        elif status.state == "waiting":
            self.end("board_lost", status.why)
        elif status.driver not in {None, SOURCE}:
            self.end("taken_over", f"{source_words(status.driver)} has taken over.")
        elif (
            status.driver is None
            and running.commanded_ns is not None
            and not running.mover.paused
            and now_ns - running.commanded_ns > OBEYS_S * NS_PER_S
        ):
            self.end("not_obeyed", f"The daemon does not drive for the moves. {status.why}")

    def event(self, event: EventSample) -> None:
        """An event of the daemon."""
        if event.kind in POSE_EVENTS:
            self.end("pose_changed", f"The pose is not the one of the plan. {event.message}")

    def twist(self, twist: TwistSample) -> None:
        """The motion by the counts."""
        self._wheels_rad_s = twist.wz

    def imu(self, sample: ImuSample, now_ns: int) -> None:
        """The motion by the gyro, if there is one."""
        running = self._running
        if running is None:
            return
        turn = sample.gyro_rad_s[2] - sample.gyro_bias_rad_s
        if differs := running.mover.watch.disagree(self._wheels_rad_s, turn, now_ns):
            self.end(*differs)

    def pose(self, pose: PoseSample, now_ns: int) -> None:
        """Command the next velocity for a new pose."""
        self.check(now_ns)
        self._pose, self._pose_ns = pose, now_ns
        running = self._running
        if running is None:
            return
        mover = running.mover
        if mover.watch.uncertain(pose.covariance, running.uncertain_m):
            self.end(
                "uncertain",
                f"The place is uncertain by more than {running.uncertain_m:g} m since the begin.",
            )
            return
        twist = mover.step(_pose(pose), now_ns)
        if mover.ended is not None:
            self.end(mover.ended.reason, mover.ended.message)
        elif twist is not None:
            # Where it waits or is paused, the daemon need not drive.
            if twist.is_zero:
                running.commanded_ns = None
            elif running.commanded_ns is None:
                running.commanded_ns = now_ns
            self._drive(twist)

    # Time.

    def check(self, now_ns: int) -> None:
        """End moves without beats or poses; call it often, and before each pose."""
        running = self._running
        if running is None:
            return
        silent_s = (now_ns - running.beat_ns) / NS_PER_S
        if silent_s > SILENCE_S:
            self.end("client_silent", f"The client that asked was silent for {silent_s:.1f} s.")
        elif now_ns - self._pose_ns > POSE_S * NS_PER_S:
            self.end("no_pose", f"No pose came for {POSE_S:g} s, or this service did not run.")

    def end(self, reason: Reason, message: str) -> None:
        """End the moves and stop the robot; does nothing if none are driven."""
        running = self._running
        if running is None:
            return
        running.mover.end(reason, message)
        self._running = None
        self._stop(f"moves of {running.by[:MOST_NAME] or running.id}: {reason}")
        self._tell(running, "ended", reason, message)

    def report(self) -> None:
        """Publish the progress if moves are driven."""
        running = self._running
        if running is not None:
            self._tell(running, "paused" if running.mover.paused else "running", "", "")

    def _tell(self, running: Running, state: str, reason: str, message: str) -> None:
        progress = running.mover.progress
        self.last = MoveSample(
            stamp_ns=0,
            id=running.id,
            state=state,
            kind=progress.kind,
            index=progress.index,
            count=running.count,
            done=1.0 if reason == "reached" else progress.done,
            left_m=progress.left_m,
            left_rad=progress.left_rad,
            left_s=progress.left_s,
            reason=reason,
            message=message,
            by=running.by,
        )
        self._publish(self.last)


def _pose(sample: PoseSample) -> Pose2d:
    return Pose2d(x=sample.x, y=sample.y, theta=sample.theta)


def _finite(given: Move | MoveRequest) -> bool:
    return all(
        math.isfinite(value)
        for name in given.__struct_fields__
        if isinstance(value := getattr(given, name), float)
    )
