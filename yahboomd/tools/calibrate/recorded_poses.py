"""Reads wheel angles and another sensor's poses from a recording: any bag that rosbags reads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from yahboomd.core.errors import Refused, YahboomdError
from yahboomd.tools.calibrate.estimates.sensor import Tracks

if TYPE_CHECKING:
    from yahboomd.core.config import Config

JOINTS = "sensor_msgs/msg/JointState"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
POSES = {
    "nav_msgs/msg/Odometry": lambda message: message.pose.pose,
    "geometry_msgs/msg/PoseStamped": lambda message: message.pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: message.pose.pose,
}
"""Message types with a pose, and its place in them."""


def tracks(
    bags: Sequence[Path], config: Config, *, topic: str, frames: tuple[str, str] | None
) -> Tracks:
    """Read a recording.

    Args:
        bags: Folders of ROS 2's bags (``yahboomd record`` makes one), or files of ROS 1's.
        frames: Parent and child of the transform, if ``topic`` carries transforms.

    Raises:
        Refused: It lacks the joint states or the poses; the message lists its topics.
    """
    from rosbags.highlevel import AnyReader

    wheels: list[tuple[float, float, float]] = []
    poses: list[tuple[float, float, float, float]] = []
    seen: set[str] = set()
    sides = _sides(config)
    if missing := [str(bag) for bag in bags if not bag.exists()]:
        raise Refused(f"There is no recording {', '.join(missing)}.")
    try:
        for bag in bags:
            with AnyReader([bag]) as reader:
                seen |= {f"{each.topic} ({each.msgtype})" for each in reader.connections}
                wanted = [
                    each
                    for each in reader.connections
                    if each.topic == topic or each.msgtype == JOINTS
                ]
                for connection, _, raw in reader.messages(connections=wanted):
                    message: Any = reader.deserialize(raw, connection.msgtype)
                    if connection.msgtype == JOINTS:
                        wheels += _wheels(message, sides)
                    elif connection.msgtype == TRANSFORMS:
                        poses += _transforms(message, frames)
                    elif connection.msgtype in POSES:
                        pose = POSES[connection.msgtype](message)
                        poses.append(_pose(message.header.stamp, pose.position, pose.orientation))
    except YahboomdError:
        raise
    except Exception as error:
        # Parsers raise many errors for a damaged file: KeyError, ZstdError, UnicodeDecodeError.
        words = f"The recording cannot be read: {str(error) or type(error).__name__}"
        raise Refused(
            words,
            remedy="For a recording of yahboomd, give the folder, or its ros2_0.mcap. `mcap "
            "recover` repairs a truncated file.",
        ) from error
    if not wheels:
        raise Refused(
            f"The recording has no joint states of {', '.join(sides)}: was it made of this robot, "
            f"with this configuration? It has {_listed(seen)}."
        )
    if not poses:
        what = f"{frames[0]} to {frames[1]} on {topic}" if frames else topic
        raise Refused(f"The recording has no poses of {what}. It has {_listed(seen)}.")
    wheel = _rising(np.array(wheels))
    pose_rows = _rising(np.array(poses))
    return Tracks(
        time_s=wheel[:, 0],
        left=wheel[:, 1],
        right=wheel[:, 2],
        separation_m=config.chassis.wheel_separation_m,
        pose_time_s=pose_rows[:, 0],
        pose=pose_rows[:, 1:],
    )


def _sides(config: Config) -> dict[str, tuple[int, float]]:
    """The side of each joint, and how far the side moves for a radian of it."""
    from yahboomd.core.config.calibration_file import geometry_of

    radius_m = geometry_of(config).wheel_radius_m
    wheels = config.kinematics().wheels
    side = {
        config.joint_name(motor.name): int(wheels[motor.wheel].endswith("right"))
        for motor in config.motors()
    }
    sharing = [list(side.values()).count(each) for each in (0, 1)]
    return {joint: (each, radius_m / sharing[each]) for joint, each in side.items()}


def _wheels(
    message: Any,  # noqa: ANN401 - made by rosbags from the definition in the file
    sides: dict[str, tuple[int, float]],
) -> list[tuple[float, float, float]]:
    angles = dict(zip(message.name, message.position, strict=False))
    if not set(sides) <= set(angles):
        return []
    travel = [0.0, 0.0]
    for joint, (side, per_radian) in sides.items():
        travel[side] += per_radian * float(angles[joint])
    return [(_seconds(message.header.stamp), *travel)]  # type: ignore[list-item]


def _transforms(
    message: Any,  # noqa: ANN401 - made by rosbags from the definition in the file
    frames: tuple[str, str] | None,
) -> list[tuple[float, float, float, float]]:
    return [
        _pose(each.header.stamp, each.transform.translation, each.transform.rotation)
        for each in message.transforms
        if (each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/")) == frames
    ]


def _pose(stamp: Any, position: Any, turn: Any) -> tuple[float, float, float, float]:  # noqa: ANN401
    heading = math.atan2(
        2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2)
    )
    return _seconds(stamp), float(position.x), float(position.y), heading


def _seconds(stamp: Any) -> float:  # noqa: ANN401
    return float(stamp.sec) + float(stamp.nanosec) * 1e-9


def _rising(rows: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """The rows sorted by time, without duplicate times."""
    order = np.argsort(rows[:, 0], kind="stable")
    rows = rows[order]
    kept: np.ndarray[Any, Any] = rows[np.concatenate(([True], np.diff(rows[:, 0]) > 0.0))]
    return kept


def _listed(seen: set[str]) -> str:
    return ", ".join(sorted(seen)) or "no topics"
