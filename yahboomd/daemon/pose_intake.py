"""Poses that arrive as samples: ROS 2's message, or the native request; each is set or refused."""

from __future__ import annotations

from yahboomd.bus.subscriptions import Arrival
from yahboomd.daemon.requests import Operator
from yahboomd.messages import cdr
from yahboomd.messages.codecs import Refusal, decode_set_pose
from yahboomd.messages.native import SetPoseRequest
from yahboomd.messages.set_pose import decode_pose
from yahboomd.model import Pose2d


class PoseIntake:
    """Sets the pose by samples.

    Args:
        frame_id: The frame that a ROS 2 message has to name: the odometry's, prefix included.
    """

    def __init__(self, operator: Operator, frame_id: str) -> None:
        self._operator = operator
        self._frame_id = frame_id

    def take(self, arrivals: list[Arrival]) -> None:
        """Take what arrived together."""
        for arrival in arrivals:
            wanted = self._decode(arrival.payload)
            if isinstance(wanted, str):
                self._operator.refuse_pose(wanted)
            else:
                pose = Pose2d(x=wanted.x, y=wanted.y, theta=wanted.theta)
                self._operator.set_pose(pose, wanted.covariance)

    def _decode(self, payload: bytes) -> SetPoseRequest | str:
        if cdr.is_cdr(payload):
            return decode_pose(payload, self._frame_id)
        wanted = decode_set_pose(payload)
        return f"{wanted.reason}: {wanted.detail}" if isinstance(wanted, Refusal) else wanted
