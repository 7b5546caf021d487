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

    def engage_estop(self, by: str, *, times: int = 1, unread: int = 0) -> str:
        """Stop at once and stay so. Returns what was done.

        Args:
            by: Who or what asked for it.
            times: How often it was asked for since the last call.
            unread: How often by something so long that it was not read.
        """
        controller = self._controller
        news = self._latch.engage(by, self._clock.now_ns())
        # The wheels first, then the disk, then the words.
        controller.stop_now()
        controller.counters["estops"] += times
        controller.counters["estops_unread"] += unread
        self._latch.remember()
        if not news:
            return "The emergency stop was engaged already."
        how = " that was too long to be read" if unread else ""
        words = f"Emergency stop engaged by {by}{how}."
        controller.event(Event(kind="estop", severity="warning", message=words))
        return words

    async def remembered(self, words: str) -> str:
        """The words of an engaged e-stop once its latch is on file; a hung disk adds a sentence.

        Args:
            words: What :meth:`engage_estop` returned.
        """
        if await self._latch.on_file():
            return words
        return f"{words} It is not on file yet, and would not survive a restart."

    def refuse_release(self, by: str, *, times: int = 1) -> str:
        """Count attempts to release the e-stop where that is refused. Returns the words for them.

        Args:
            by: How it was attempted.
            times: How often since the last call.
        """
        self._controller.counters["release_refused"] += times
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
        # Commands that waited with this request may be handled after it.
        controller.notice_pause()
        moving = self._arbiter.moving_sources(self._clock.now_ns())
        if moving and controller.faulty and not was_engaged:
            controller.counters["release_refused"] += 1
            words = (
                f"The fault stays: {', '.join(moving)} commands motion, or did within the last "
                "second. Let go of the controls, wait a second, then clear it again."
            )
            return False, words
        release = self._latch.release(moving)
        if not release.released:
            controller.counters["release_refused"] += 1
            return False, release.message
        fault = controller.clear_fault()
        if fault is None:
            words = release.message if was_engaged else "Nothing to release: no e-stop, no fault."
        else:
            # Its remedy is over; what happened is in the first sentence.
            cleared = f"Cleared the fault: {fault.partition('. ')[0].removesuffix('.')}."
            words = f"{release.message} {cleared}" if was_engaged else cleared
        if was_engaged or fault is not None:
            # What arrived while the disk was busy with the release is over, like all before it.
            self._arbiter.forget_commands(self._clock.now_ns())
            controller.event(Event(kind="estop_released", severity="info", message=words))
        return True, words

    def set_pose(self, pose: Pose2d, covariance: Matrix3 | None) -> str:
        """Declare where the robot is. Returns what was done."""
        self._controller.set_pose(pose, covariance)
        words = f"The pose is x {pose.x:g} m, y {pose.y:g} m, theta {pose.theta:g} rad."
        self._controller.event(Event(kind="pose_set", severity="info", message=words))
        return words
