"""The robot under test, with daemon and application, and the checks after a fault."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

from benchmarks.rig import free_endpoint
from benchmarks.soak.application import Application
from benchmarks.soak.ledger import Ledger
from benchmarks.soak.poses import SEPARATION_M, error, way_covariance
from benchmarks.soak.processes import Board, ServiceManager, Stalls
from benchmarks.soak.tail import Order, is_stop
from benchmarks.soak.waiting import Waiting
from yahboomd.core.messages.native import PoseSample
from yahboomd.simulation.truth import TruthSample

LOOK_S = 0.01
RECOVER_S = 25.0
EXCUSE_S = 0.1
"""A machine that stands still for this time is no real-time machine; its effects are noted only."""

EXCUSE_WAIT_S = 0.5
"""The same for one thread of the soak that is ready to run and waits this time in all."""

BRAKE_S = 0.8
"""The time after a stop frame in which wheels at the soak's speeds stop, with a margin."""


MOST_M = 0.03
MOST_RAD = 0.03
"""The largest error of a way between two stands, on a line that is no worse than it should be."""

SIGMAS = 3.0
"""Larger errors are allowed up to this many standard deviations of the published covariance."""

NEAR_ZERO = "a polled board was reset with its counters near zero"
"""The board does not report it, and a wheel may have rolled from one small count to another."""


NOISY = frozenset({"byte loss", "corruption", "output stall"})
"""Faults that keep sent speeds from the board, so that wheels may be cut."""


class Course:
    """A robot that is driven and disturbed.

    Args:
        folder: The folder for all files.
        seed: Decides everything random.
        ledger: Records the findings.
        dialect: The dialect of the first board.
    """

    def __init__(self, folder: Path, seed: int, ledger: Ledger, dialect: str) -> None:
        self.random = Random(seed)
        self.ledger = ledger
        self.folder = folder
        self.endpoint = free_endpoint()
        self.began_ns = time.monotonic_ns()
        self._anchor: tuple[PoseSample, TruthSample, int] | None = None
        self.apart = ""
        self.resets = 0
        self.kind = ""
        self.turn_ns = self.began_ns
        self.damaged_ns = 0
        self.stalls = Stalls()
        try:
            self.board = Board(folder, dialect, seed)
        except BaseException:
            self.stalls.close()
            raise
        self.manager = ServiceManager(folder, self.board.port, self.endpoint)
        self.waiting = Waiting(lambda: (self.manager.life.pid, self.board.process.pid, os.getpid()))
        try:
            self.app = Application(self.endpoint, Random(seed + 1))
        except BaseException:
            self.waiting.close()
            self.manager.close()
            self.board.close()
            self.stalls.close()
            raise

    def close(self) -> None:
        """End everything."""
        self.app.close()
        self.waiting.close()
        self.manager.close()
        self.board.close()
        self.stalls.close()

    def change_board(self, dialect: str) -> None:
        """Put another board behind the same port name; the daemon goes on."""
        self._anchor = None
        self.resets = 0
        self.board.close()
        self.board = Board(self.folder, dialect, self.random.randrange(1 << 30))

    @property
    def streamed(self) -> bool:
        """Whether the board streams."""
        return self.board.dialect == "streamed"

    @property
    def announces(self) -> bool:
        """Whether the board reports its resets."""
        return self.board.dialect != "polled"

    def fail(self, words: str) -> None:
        """Record a failure."""
        at_s = (time.monotonic_ns() - self.began_ns) / 1e9
        status = self.app.status
        state = f"{status.state}: {status.why}" if status is not None else "no status"
        words = f"{at_s:8.1f} s  {self.board.dialect} {self.kind}: {words} [{state}]"
        self.ledger.failures.append(words)
        print(words, flush=True)

    def unexpected(self, words: str, since_ns: int | None = None) -> None:
        """Record a failure, unless the machine did not run the soak's processes.

        Args:
            words: The failure.
            since_ns: The time from which the machine could have caused it; by default the beginning
                of the fault.
        """
        since_ns = self.turn_ns if since_ns is None else since_ns
        stood_s = self.stalls.longest_s(since_ns)
        waited_s = self.waiting.within_s(since_ns, time.monotonic_ns())
        if stood_s < EXCUSE_S and waited_s < EXCUSE_WAIT_S:
            self.fail(words)
        else:
            print(f"set apart ({stood_s:.2f} s stood still, {waited_s:.2f} s waited): {words}")
            self.ledger.notes[f"while the machine stood still: {words}"] += 1

    def wait(self, condition: Callable[[], object], within_s: float) -> bool:
        """Wait for a condition; returns whether it came true in time."""
        deadline = time.monotonic() + within_s
        while not condition():
            if time.monotonic() > deadline:
                return False
            time.sleep(LOOK_S)
        return True

    def stalled_s(self, since_ns: int, until_ns: int) -> float:
        """The time that the machine stood still, or let one of the soak's threads wait."""
        return max(
            self.stalls.within_s(since_ns, until_ns), self.waiting.within_s(since_ns, until_ns)
        )

    @property
    def anchor(self) -> tuple[PoseSample, TruthSample] | None:
        """Pose and truth at the last stand, unless something since then is unknown."""
        if self._anchor is None or self.apart or self._anchor[2] < self.manager.life.began_ns:
            return None
        pose, truth, since_ns = self._anchor
        return None if self._unknown_m(since_ns) else (pose, truth)

    def frame(
        self, kind: str, since_ns: int, wanted: Callable[[Order], bool] = is_stop, *, wait_s: float
    ) -> None:
        """Measure from a fault to a frame."""
        found: list[Order] = []

        def come() -> bool:
            order = self.board.wire.first(since_ns, wanted)
            if order is not None:
                found.append(order)
            return order is not None

        if not self.wait(come, wait_s):
            self.unexpected(f"no frame that answers within {wait_s} s", since_ns)
            return
        until_ns = found[0].t_ns
        stalled_s = self.stalled_s(since_ns, until_ns)
        self.ledger.latency(kind, (until_ns - since_ns) / 1e9, stalled_s)

    def stands(self, since_ns: int, within_s: float, kind: str | None = None) -> int | None:
        """Verify that the wheels come to stand in time; returns when they did."""
        found: list[int] = []

        def stood() -> bool:
            at_ns = self.board.truth.stood_at(since_ns)
            if at_ns is not None:
                found.append(at_ns)
            return at_ns is not None

        # The ground truth arrives in batches of 0.2 s.
        self.wait(stood, within_s + 1.0)
        took_s = (found[0] - since_ns) / 1e9 if found else float("inf")
        until_ns = found[0] if found else time.monotonic_ns()
        if took_s > within_s + self.stalled_s(since_ns, until_ns):
            speed = self.board.truth.fastest_m_s(until_ns - 100_000_000, until_ns)
            self.unexpected(
                f"the wheels stand after {took_s:.2f} s, not {within_s:.2f} ({speed:.2f} m/s)",
                since_ns,
            )
            return found[0] if found else None
        self.ledger.stopped(kind or self.kind, took_s)
        return found[0]

    def stays(self, since_ns: int, for_s: float) -> None:
        """Verify that the wheels do not move for a while."""
        until_ns = since_ns + round(for_s * 1e9)
        self.wait(lambda: self.board.truth.since(until_ns), for_s + 2.0)
        speed = self.board.truth.fastest_m_s(since_ns, until_ns)
        if speed > 0.03:
            self.fail(f"the wheels moved at {speed:.2f} m/s while they had to stand")

    def move(self, vx: float = 0.35, wz: float = 0.3, for_s: float = 0.7) -> None:
        """Make the wheels turn, at a steady speed."""
        self.app.steady(vx, wz)
        slow_ns = time.monotonic_ns()
        if not self.wait(lambda: self.board.truth.travelled_m(slow_ns) > 0.02, 10.0):
            self.unexpected("it does not drive")
        time.sleep(for_s)

    def ready(self) -> bool:
        """Wait until it may drive, and release latches as a person would."""
        self.app.steady(0.0)
        began_ns = time.monotonic_ns()
        deadline = time.monotonic() + RECOVER_S
        while time.monotonic() < deadline:
            status = self.app.status
            if status is not None and status.state in {"standing", "driving", "stopping"}:
                return True
            if status is not None and status.state in {"estopped", "fault"}:
                self.app.silent()
                time.sleep(1.1)
                reply = self.app.ask("yahboomd/estop/reset")
                if reply is None or not reply.success:
                    self.ledger.notes[f"release refused: {reply.message if reply else '-'}"] += 1
                self.app.steady(0.0)
                time.sleep(0.2)
            time.sleep(LOOK_S)
        took_s = (time.monotonic_ns() - began_ns) / 1e9
        self.unexpected(f"it is not ready after {took_s:.1f} s")
        return False

    def drives_again(self, since_ns: int) -> None:
        """Verify that the robot moves as commanded."""
        self.app.wander()
        began_ns = time.monotonic_ns()
        if not self._moves(began_ns) and not self._moves_when_released(since_ns):
            self.unexpected("it does not drive again")
            return
        self.ledger.drives += 1
        self.ledger.recovery_s.append((time.monotonic_ns() - since_ns) / 1e9)

    def _moves(self, since_ns: int) -> bool:
        def moved() -> bool:
            return self.board.truth.travelled_m(since_ns) > 0.05

        self.wait(lambda: moved() or self.latched, RECOVER_S)
        return moved()

    def _moves_when_released(self, since_ns: int) -> bool:
        """After a reset that nothing shows, release the robot as a person would."""
        if not self.latched:
            return False
        if self.kind in NOISY:
            # Another check judges with all events whether the fault was right.
            self.ledger.notes[f"{self.kind}: {self.why}"] += 1
        elif self.apart == NEAR_ZERO:
            self.ledger.notes["an unannounced reset: released by a person"] += 1
        else:
            self.unexpected(f"it drives, and latches: {self.why}", since_ns)
        if not self.ready():
            return False
        self.app.wander()
        return self._moves(time.monotonic_ns())

    @property
    def latched(self) -> bool:
        """Whether a fault or an e-stop is latched."""
        status = self.app.status
        return status is not None and status.state in {"fault", "estopped"}

    @property
    def why(self) -> str:
        """The status's reason to stand, without figures that change."""
        status = self.app.status
        return status.why.split(":")[0].split("(since")[0] if status is not None else "no status"

    def compare(self) -> None:
        """Stand still, and compare the way since the last time with the true one."""
        self.app.steady(0.0)
        began_ns = time.monotonic_ns()
        life = self.manager.life
        if not self.wait(lambda: self.board.truth.stood_at(began_ns), 5.0):
            self.unexpected("it does not stand when commanded to")
            return
        # After this time the last counts before the standstill have been published.
        time.sleep(0.25)
        now_ns = time.monotonic_ns()
        if not self.wait(lambda: self.app.pose_since(now_ns), 5.0) or not self.wait(
            lambda: bool(self.board.truth.since(now_ns)), 5.0
        ):
            self.unexpected("no pose while it stands")
            self._anchor = None
            return
        truth = self.board.truth.since(now_ns)
        pose = self.app.pose_since(now_ns)
        assert pose is not None
        anchor, self._anchor = self._anchor, (pose, truth[0], now_ns)
        apart, self.apart = self.apart, ""
        if anchor is None or anchor[2] < life.began_ns:
            return
        if apart:
            self.ledger.apart[apart] += 1
            self._begin_again()
            return
        where = _pose(pose)
        metres, radians = error(_pose(anchor[0]), where, _place(anchor[1]), _place(truth[0]))
        ways = zip(anchor[1].travel_m, truth[0].travel_m, strict=True)
        way_m = max(abs(b - a) for a, b in ways)
        most_m, most_rad = MOST_M, MOST_RAD
        if unknown_m := self._unknown_m(anchor[2]):
            # The unseen travel of a wheel turns the base, and bends the rest of the way.
            turned = 2.0 * unknown_m / SEPARATION_M
            most_m += unknown_m + way_m * min(2.0, turned)
            most_rad += turned
            self.ledger.uncertain += 1
            self._begin_again()
        else:
            # A bad line without a checksum can hide this; the covariance may show it.
            xx, yy, tt = way_covariance(
                _pose(anchor[0]), anchor[0].covariance, where, pose.covariance
            )
            most_m += SIGMAS * math.sqrt(xx + yy)
            most_rad += SIGMAS * math.sqrt(tt)
            if metres > MOST_M or radians > MOST_RAD:
                self.ledger.covered += 1
            if metres > max(self.ledger.errors_m, default=0.0):
                self.ledger.worst_way = (
                    f"{self.board.dialect}, {self.kind}, {way_m:.1f} m; {SIGMAS:g} standard "
                    f"deviations of its covariance are {(most_m - MOST_M) * 1e3:.1f} mm"
                )
            self.ledger.errors_m.append(metres)
            self.ledger.errors_rad.append(radians)
            self.ledger.driven_m += way_m
        if metres > most_m or radians > most_rad:
            self.fail(f"the pose is {metres * 1e3:.1f} mm and {radians:.4f} rad off the truth")

    def _begin_again(self) -> None:
        """Reset the pose, because the uncertainty of this way would hide that of the next."""
        self.app.poses.pause()
        reply = self.app.ask("yahboomd/odometry/reset")
        if reply is None or not reply.success:
            self.unexpected(f"no reset of the pose: {reply.message if reply else 'no answer'}")
        time.sleep(0.25)
        self.app.poses.resume()
        now_ns = time.monotonic_ns()
        if self._anchor is not None and self.wait(lambda: self.app.pose_since(now_ns), 5.0):
            pose = self.app.pose_since(now_ns)
            assert pose is not None
            self._anchor = (pose, *self._anchor[1:])

    def _unknown_m(self, since_ns: int) -> float:
        """The travel of each wheel that was reported as unknown."""
        lost = self.app.events_since(since_ns, "odometry_discontinuity")
        return sum(float((event.data or {}).get("unknown_m") or 0.0) for event in lost)


def _pose(pose: PoseSample) -> tuple[float, float, float]:
    return pose.x, pose.y, pose.theta


def _place(truth: TruthSample) -> tuple[float, float, float]:
    return truth.x, truth.y, truth.theta
