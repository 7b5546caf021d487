"""Commands to the board: speeds, standstill and its proof, and the cut.

It decides nothing about who may drive. It makes sure that a stop is obeyed: sent before everything
else if it must not wait, repeated until the counters show it, and ended by letting the motors go if
they do not obey.
"""

from __future__ import annotations

from collections import Counter

from yahboomd.core.clock import nanoseconds
from yahboomd.core.daemon.fit import BoardFit, no_board
from yahboomd.core.drive.faults import Fault
from yahboomd.core.drive.follow_check import FollowCheck
from yahboomd.core.drive.kinematics import motor_speeds
from yahboomd.core.drive.rest import AtRest, Rest
from yahboomd.core.drive.stop_watch import StopWatch
from yahboomd.core.link.connected_board import ConnectedBoard
from yahboomd.core.model import Kinematics, Motor
from yahboomd.core.protocol.dialect import Units
from yahboomd.core.standstill import HUNTS_M, REPEAT_S, UNMOVED_S, turning

WAITED_NS = 100_000_000
"""The time after a pause of this process in which counts arrive that waited."""

LATE_NS = 60_000_000
"""A reading that took this long was held up on its way, and so, perhaps, was the command."""

SAID_AGAIN_NS = 150_000_000
"""Frames that were held up arrive together, and the board keeps one of them: the others are sent
again within this time."""

STOP_HELD_UP_NS = 600_000_000
"""A stop that was held up has this time from then on."""

JUDGED_NS = 15_000_000
"""Wheels are judged no more often, by their counts since: a board that streams reports more
often than a wheel can show anything new."""


class Wheels:
    """The wheels, with or without a board to turn them.

    Args:
        motors: The motors, in the order of its wheels.
        at_rest: The treatment of standing wheels.
        min_speed_m_s: Commands below it prove nothing about missing counts.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        motors: tuple[Motor, ...],
        *,
        at_rest: AtRest,
        min_speed_m_s: float,
        counters: Counter[str],
    ) -> None:
        names = tuple(motor.name for motor in motors)
        self._kinematics = kinematics
        self._motors = motors
        self._counters = counters
        metres_per_tick = [motor.metres_per_tick for motor in motors]
        self.check = FollowCheck(names, metres_per_tick, min_speed_m_s=min_speed_m_s)
        self._rest = Rest(at_rest, names, metres_per_tick)
        self._stop_watch = StopWatch(names)
        self._board: ConnectedBoard | None = None
        self._released = False
        self._stop_due_ns: int | None = None
        self._held_up_ns = 0
        self._ticks: tuple[int, ...] | None = None
        self._judged_ns = 0
        self._waited_ns = 0
        self.fit: BoardFit = no_board(kinematics)
        self.zeros = (0.0,) * len(motors)
        self.command_m_s = self.zeros
        self.measured_m_s: tuple[float, ...] | None = None
        self.seen: str | None = None
        self._metres_per_tick = metres_per_tick
        self._moved_at: tuple[tuple[int, ...], int] = (), 0
        self.unmoved_m_s = 0.0
        """The fastest setpoint of wheels of which none moves; 0 if one does, or none shall."""
        self._said: tuple[Units, tuple[float, ...]] = ((), self.zeros)

    # The board comes and goes.

    def attach(self, board: ConnectedBoard, fit: BoardFit) -> None:
        """Take a board; it was stopped while it was connected."""
        self._board = board
        self.fit = fit
        self._released = False
        self._rest.drive()
        self._stop_watch.cancel()
        self.check.law = fit.law
        self.check.reset()

    def detach(self) -> None:
        """Note that there is no board any more; the motion of the wheels is unknown."""
        self._board = None
        self.command_m_s = self.zeros
        self.measured_m_s = None
        self._stop_watch.cancel()

    def rearm(self) -> None:
        """Send the board its set-up again: it may have been reset unnoticed."""
        if self._board is not None:
            self._board.rearm()

    @property
    def noisy(self) -> bool:
        return self._board is not None and self._board.noisy

    @property
    def damages(self) -> int:
        return 0 if self._board is None else self._board.damages

    @property
    def attached(self) -> bool:
        return self._board is not None

    def turn(self, speeds: tuple[float, ...]) -> None:
        """Turn: rim speed of each wheel of the geometry, m/s."""
        self._stop_watch.cancel()
        self._stop_due_ns = None
        self._released = False
        self._rest.drive()
        self.seen = "turning"
        self._say(speeds)

    def stand(self, now_ns: int, *, at_once: bool) -> Fault | None:
        """Stop the wheels, and check that they obey; called in every step while they are to stand.

        Args:
            at_once: Send it before everything that waits, and again until it is obeyed.

        Returns:
            The fault of a stop that is not obeyed, once. The motors are cut with it, and also,
            without a fault, if the wheels slow down and need longer than a stop may take.
        """
        moved = any(self.command_m_s)
        board = self._board
        if board is None:
            self.command_m_s = self.zeros
            return None
        if self.fit.motion is None:
            # A person who leans on a wheel wakes the speed loop of a board with such settings,
            # even at a commanded zero: it is sent no speed at all.
            if not self._released:
                self.release(now_ns)
            return None
        watch = self._stop_watch
        if moved or watch.state == "idle":
            watch.begin(now_ns)
            self._stop_due_ns = now_ns if at_once else None
        elif at_once and self._stop_due_ns is None and watch.state == "stopping":
            self._stop_due_ns = now_ns
        if watch.state == "stopped":
            self._stop_due_ns = None
        if self._stop_due_ns is not None and now_ns >= self._stop_due_ns and not self._released:
            board.brake()
            self._counters["stops_said"] += 1
            self._stop_due_ns = now_ns + nanoseconds(REPEAT_S)
        due = watch.state == "stopping"
        doubtful = self.noisy or now_ns < self._held_up_ns + STOP_HELD_UP_NS
        fault = watch.check(now_ns, noisy=doubtful)
        if fault is not None or (due and watch.state == "overdue"):
            self.cut(now_ns)
            if fault is None:
                self._counters["slow_stops"] += 1
                self._rest.let_go(max(map(abs, self.measured_m_s or (0.0,))))
        elif not self._released:
            # If a wheel never counted for its commands, its counter cannot prove that it stands,
            # and the board's speed loop would keep it as fast as it is.
            owing, stood = self.check.owing, self._rest.lets_go and board.cuts
            if watch.state == "stopped" and (owing or stood):
                self.release(now_ns)
                if not owing:
                    self._rest.let_go()
            else:
                self._say((0.0,) * len(self._kinematics.wheels))
        return fault

    def stop_again(self, now_ns: int) -> None:
        """Send the next stop at once, and begin to watch for standstill again."""
        self._stop_due_ns = now_ns
        if self._rest.free:
            self._released = False
            self._rest.drive()
        if self._stop_watch.state != "stopping":
            self._stop_watch.cancel()

    def release(self, now_ns: int) -> None:
        """Release the motors, and repeat that until the wheels are to turn."""
        self._released = True
        self._rest.free = False
        self.command_m_s = self.zeros
        self.check.command(now_ns, None)
        if self._board is not None:
            self._board.release()

    def cut(self, now_ns: int) -> None:
        if self._board is not None:
            self._board.cut()
        self._counters["cuts"] += 1
        self.release(now_ns)

    def sent(self, units: Units | None, now_ns: int) -> None:
        """Compare the wheels only with the motion that was written to the port.

        Args:
            units: The motion, in the board's units; ``None`` for a release.
        """
        said, speeds_m_s = self._said
        # Any other frame is a stop: stops overtake velocities.
        if units is not None and units != said:
            speeds_m_s = self.zeros
        self.check.command(now_ns, None if units is None else speeds_m_s)

    def paused(self, now_ns: int) -> None:
        """Note a pause of this process: data that arrives now is old, and proves nothing.

        A stop that is under way is sent again, and has its time again.
        """
        self.check.reset()
        if self._board is not None:
            # The kernel keeps the oldest lines; the newest one contains their counts.
            self._board.drop_input()
        self._waited_ns = now_ns + WAITED_NS
        self._stop_watch.restart(now_ns)
        if self._stop_watch.state == "stopping":
            self._stop_due_ns = now_ns

    def stopped_by_guard(self, now_ns: int) -> None:
        """Note that the guard sent a stop: no wheel is held against the motion before it."""
        self._counters["guard_stops"] += 1
        if not self._released:
            self.check.command(now_ns, self.zeros)

    def measure(
        self,
        stamp_ns: int,
        speeds_m_s: tuple[float, ...],
        ticks: tuple[int, ...],
        received_ns: int | None = None,
        earliest_ns: int | None = None,
    ) -> tuple[Fault, ...]:
        """Check a measurement.

        Args:
            ticks: Travelled counts of each motor since the start.
            received_ns: When they arrived, if that is known as well as the stamp.
            earliest_ns: The earliest time at which the board sampled them, if the stamp is only the
                likeliest moment between.
        """
        self.measured_m_s = speeds_m_s
        self.seen = "turning" if self.in_motion else "at_rest"
        self.unmoved_m_s = self._unmoved(stamp_ns, ticks)
        before = self._ticks or ticks
        if self._board is None:
            # The session that closed the board stops its wheels; they obey no command of ours.
            self._ticks = ticks
            return ()
        if (received_ns or stamp_ns) < self._waited_ns:
            self.check.reset()
            self._ticks = ticks
            return ()
        asked_ns = stamp_ns if earliest_ns is None else earliest_ns
        # If answers are lost one seems late as well; then a speed is repeated every 25 ms.
        if received_ns is not None and received_ns - asked_ns > LATE_NS and not self.noisy:
            self._held_up_ns = received_ns + SAID_AGAIN_NS
        self._stop_watch.measure(stamp_ns, speeds_m_s)
        rests = self.stopped or self._rest.free
        if rests and (rolled := self._rest.measure(stamp_ns, ticks, stand=self.stopped)):
            self._released = False
            self._stop_watch.restart(stamp_ns)
            self._say((0.0,) * len(self._kinematics.wheels))
            return (rolled,)
        if 0 < stamp_ns - self._judged_ns < JUDGED_NS:
            return ()
        self._judged_ns, self._ticks = stamp_ns, ticks
        deltas = tuple([b - a for a, b in zip(before, ticks, strict=True)])
        return self.check.measure(
            stamp_ns,
            speeds_m_s,
            deltas,
            received_ns=received_ns,
            earliest_ns=earliest_ns,
            held_up=stamp_ns < self._held_up_ns,
        )

    @property
    def stopped(self) -> bool:
        """Whether readings from after the stop show that the wheels obeyed it."""
        return self._stop_watch.state == "stopped"

    @property
    def stop_sent(self) -> bool:
        """Whether the last command to a board is a stop that has left this machine."""
        return self._board is not None and self._board.stop_sent

    @property
    def in_motion(self) -> bool:
        return any(self.command_m_s) or turning(self.measured_m_s or ())

    def _unmoved(self, stamp_ns: int, ticks: tuple[int, ...]) -> float:
        place, since_ns = self._moved_at
        fastest_m_s = max(map(abs, self.command_m_s))
        far_m = [
            abs(now - then) * metre
            for now, then, metre in zip(ticks, place, self._metres_per_tick, strict=False)
        ]
        if not fastest_m_s or not far_m or max(far_m) > HUNTS_M:
            self._moved_at = ticks, stamp_ns
        return fastest_m_s if stamp_ns - since_ns >= nanoseconds(UNMOVED_S) else 0.0

    def _say(self, speeds: tuple[float, ...]) -> None:
        self.command_m_s = motor_speeds(self._motors, speeds)
        if self._board is not None and self.fit.motion is not None:
            units = self.fit.motion.units(speeds)
            self._said = (units, self.command_m_s)
            self._board.drive(units)
