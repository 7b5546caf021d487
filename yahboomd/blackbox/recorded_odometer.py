"""An odometer that records those of its inputs that the bytes of the board do not show."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from msgspec import structs

from yahboomd.blackbox.kept_pose import PoseFile
from yahboomd.blackbox.recorder import Recorder
from yahboomd.core.model import EncoderReading, Matrix3, Pose2d
from yahboomd.core.odometry import snapshot
from yahboomd.core.odometry.odometer import Odometer, OdometerSettings, Update

MISSION_NS = 60_000_000_000
"""After a longer absence, counts that do not go on begin another mission: at the origin."""

AT_ORIGIN = (
    "yahboomd starts again, and the board's counts do not go on from its last ones: the pose broke "
    "and begins at the origin. Set it: `yahboomd pose --to X Y THETA`, or `--reset`."
)


def odometer(
    settings: OdometerSettings, recorder: Recorder | None, poses: PoseFile | None = None
) -> Odometer:
    """The odometer of a daemon; with a recorder, its inputs are recorded.

    Args:
        poses: Keeps its pose, and has the one to continue from.
    """
    arguments = structs.asdict(settings)
    if recorder is None:
        return Odometer(**arguments)
    return RecordedOdometer(recorder, poses, **arguments)


class RecordedOdometer(Odometer):
    """The odometer of a daemon with a black box.

    Args:
        recorder: Records its inputs, and periodically its state.
        poses: As of :func:`odometer`.
        arguments: The odometer's own.
    """

    # Not among the attributes that are its state.
    __slots__ = ("_poses", "_recorder")

    def __init__(self, recorder: Recorder, poses: PoseFile | None, **arguments: Any) -> None:  # noqa: ANN401 - the odometer's
        super().__init__(**arguments)
        recorder.odometer_state = partial(snapshot.save, self)
        self._recorder = recorder
        self._poses = poses
        if poses is not None and (kept := poses.last) is not None:
            self.resume(kept.estimate, kept.ticks)

    def set_sample_period(
        self, period_ns: int | None, *, each_line: bool = False, age_ns: int = 0
    ) -> None:
        self._recorder.renewal(period_ns, each_line=each_line, age_ns=age_ns)
        super().set_sample_period(period_ns, each_line=each_line, age_ns=age_ns)

    def armed(self) -> None:
        self._recorder.armed()
        super().armed()

    def set_pose(self, pose: Pose2d, covariance: Matrix3 | None = None) -> None:
        self._recorder.pose_set(pose, covariance)
        super().set_pose(pose, covariance)

    def steer(self, curvature_per_m: float, now_ns: int) -> None:
        if self._steering is not None:
            self._recorder.steered(curvature_per_m, now_ns)
            super().steer(curvature_per_m, now_ns)

    def update(self, reading: EncoderReading) -> Update:
        resumed_ns = self._stamp_ns if self._resumed else math.inf
        update = super().update(reading)
        if self.broken and self._stamp_ns - resumed_ns > MISSION_NS:
            self.set_pose(Pose2d())
            self.broken = AT_ORIGIN
            events = [structs.replace(each, message=AT_ORIGIN) for each in update.events]
            update = structs.replace(update, events=tuple(events))
        if update.estimate is not None:
            self._recorder.estimate(update.estimate)
            if self._poses is not None:
                self._poses.keep(reading.ticks, update.estimate)
        return update
