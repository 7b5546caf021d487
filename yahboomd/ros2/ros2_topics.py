"""The topics and services of ROS 2: their names, types and QoS.

Zenoh delivers all samples over reliable links, but drops those that find a connection full: the
thread that publishes drives the wheels.
"""

from __future__ import annotations

import msgspec

from yahboomd.core.bus import keys
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.messages.ros2_names import Qos

ODOM = "odom"
TF = "tf"
TF_STATIC = "tf_static"
JOINT_STATES = "joint_states"
IMU = "imu/data"
IMU_RAW = "imu/data_raw"
BATTERY_STATE = "battery_state"
DIAGNOSTICS = "diagnostics"
ESTOPPED = "estopped"
ROSOUT = "rosout"


class RosTopic(msgspec.Struct, frozen=True, kw_only=True):
    """A topic that yahboomd publishes for ROS 2, in CDR."""

    ros_type: str
    qos: Qos = Qos(depth=10)


ROS_TOPICS: dict[str, RosTopic] = {
    ODOM: RosTopic(ros_type=ros2_names.ODOMETRY),
    TF: RosTopic(ros_type=ros2_names.TF_MESSAGE, qos=Qos(depth=100)),
    TF_STATIC: RosTopic(
        ros_type=ros2_names.TF_MESSAGE,
        qos=Qos(latched=True, depth=1),
    ),
    JOINT_STATES: RosTopic(ros_type=ros2_names.JOINT_STATE),
    IMU: RosTopic(ros_type=ros2_names.IMU),
    IMU_RAW: RosTopic(ros_type=ros2_names.IMU),
    BATTERY_STATE: RosTopic(
        ros_type=ros2_names.BATTERY_STATE,
        qos=Qos(latched=True, depth=1),
    ),
    ESTOPPED: RosTopic(
        ros_type=ros2_names.BOOL,
        qos=Qos(latched=True, depth=1),
    ),
    DIAGNOSTICS: RosTopic(ros_type=ros2_names.DIAGNOSTIC_ARRAY),
    ROSOUT: RosTopic(ros_type=ros2_names.LOG, qos=Qos(latched=True, depth=1000)),
}
"""The published topics, by the names that they have unless configured otherwise."""

RECEIVED: dict[str, str] = {
    keys.ESTOP: ros2_names.BOOL,
    keys.ODOMETRY_SET_POSE: ros2_names.POSE,
}
"""The types of the other topics that yahboomd subscribes to, by key."""

SERVICES: dict[str, str] = {
    keys.ESTOP: ros2_names.SET_BOOL,
    keys.ESTOP_RESET: ros2_names.TRIGGER,
    keys.ODOMETRY_RESET: ros2_names.TRIGGER,
}
"""The services whose requests ROS 2 has types for, by key."""
