"""What people ask for past the command keys: the e-stop and its release, and the pose."""

from __future__ import annotations

from yahboomd.clock import Clock
from yahboomd.daemon.control import Controller
from yahboomd.daemon.latch import EstopLatch
from yahboomd.drive.arbiter import Arbiter
from yahboomd.model import Event, Matrix3, Pose2d


class Operator:
    """Carries requests out, and says in words what became of them.

    Args:
        clock: What tells the time.
        controller: Stops the wheels.
        arbiter: Knows who commands motion.
        latch: The e-stop.
    """

    def __init__(
        self, clock: Clock, *, controller: Controller, arbiter: Arbiter, latch: EstopLatch
    ) -> None:
        self._clock = clock
        self._controller = controller
        self._arbiter = arbiter
        self._latch = latch

    def engage_estop(self, by: str) -> str:
        """Stop at once and stay so. Returns what was done."""
        controller = self._controller
        news = self._latch.engage(by, self._clock.now_ns())
        # The wheels first, then the disk, then the words.
        controller.stop_now()
        controller.counters["estops"] += 1
        if not news:
            return "The emergency stop was engaged already."
        self._latch.remember()
        words = f"Emergency stop engaged by {by}."
        controller.event(Event(kind="estop", severity="warning", message=words))
        return words

    def refuse_release(self, by: str) -> str:
        """Somebody tried to release the e-stop where it cannot be. Returns what they hear."""
        self._controller.counters["release_refused"] += 1
        words = (
            f"Not released by {by}: the service yahboomd/estop/reset releases the emergency stop."
        )
        self._controller.event(
            Event(kind="estop_release_refused", severity="warning", message=words)
        )
        return words

    def release_estop(self) -> tuple[bool, str]:
        """Release the e-stop, and clear a latched fault with it, unless somebody commands motion.

        Returns:
            Whether the robot may move again, and what was done.
        """
        controller = self._controller
        was_engaged = self._latch.engaged
        moving = self._arbiter.moving_sources(self._clock.now_ns())
        if moving and controller.faulty and not was_engaged:
            controller.counters["release_refused"] += 1
            return False, f"The fault stays: {', '.join(moving)} commands motion. Let go first."
        release = self._latch.release(moving)
        if not release.released:
            controller.counters["release_refused"] += 1
            return False, release.message
        fault = controller.clear_fault()
        if fault is None:
            words = release.message
        elif was_engaged:
            words = f"{release.message} Cleared the fault: {fault}"
        else:
            words = f"Cleared the fault: {fault}"
        if was_engaged or fault is not None:
            controller.event(Event(kind="estop_released", severity="info", message=words))
        return True, words

    def set_pose(self, pose: Pose2d, covariance: Matrix3 | None) -> str:
        """Declare where the robot is. Returns what was done."""
        self._controller.set_pose(pose, covariance)
        words = f"The pose is x {pose.x:g} m, y {pose.y:g} m, theta {pose.theta:g} rad."
        self._controller.event(Event(kind="pose_set", severity="info", message=words))
        return words
