"""An odometer that records those of its inputs that the bytes of the board do not show."""

from __future__ import annotations

from functools import partial
from typing import Any

from msgspec import structs

from yahboomd.blackbox.recorder import Recorder
from yahboomd.core.model import EncoderReading, Matrix3, Pose2d
from yahboomd.core.odometry import snapshot
from yahboomd.core.odometry.odometer import Odometer, OdometerSettings, Update


def odometer(settings: OdometerSettings, recorder: Recorder | None) -> Odometer:
    """The odometer of a daemon; with a recorder, its inputs are recorded."""
    arguments = structs.asdict(settings)
    return Odometer(**arguments) if recorder is None else RecordedOdometer(recorder, **arguments)


class RecordedOdometer(Odometer):
    """The odometer of a daemon with a black box.

    Args:
        recorder: Records its inputs, and periodically its state.
        arguments: The odometer's own.
    """

    # Not among the attributes that are its state.
    __slots__ = ("_recorder",)

    def __init__(self, recorder: Recorder, **arguments: Any) -> None:  # noqa: ANN401 - the odometer's
        super().__init__(**arguments)
        recorder.odometer_state = partial(snapshot.save, self)
        self._recorder = recorder

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
        update = super().update(reading)
        if update.estimate is not None:
            self._recorder.estimate(update.estimate)
        return update
