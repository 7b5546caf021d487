"""The keys of the bus: one name for each, all below one optional namespace.

yahboomd puts the namespace in front by itself. Zenoh has a namespace of its own for a session, but
there liveliness tokens are not seen by those who watch for them below that namespace.

A key that begins with ``/`` is taken as it stands, outside the namespace: what ROS 2's middlewares
prescribe (``/@ros2_lv/...``, ``/0/odom/...``) has its own rules for names.
"""

from __future__ import annotations

from yahboomd.core import names

CMD_VEL = "cmd_vel"
CMD_VEL_TELEOP = "cmd_vel/teleop"
CMD_VEL_WEB = names.PAGE_SOURCE

POSE = "yahboomd/pose"
TWIST = "yahboomd/twist"
WHEELS = "yahboomd/wheels"
IMU = "yahboomd/imu"
BATTERY = "yahboomd/battery"
STATUS = "yahboomd/status"
EVENTS = "yahboomd/events"

SAMPLES = (POSE, TWIST, WHEELS, IMU, BATTERY, STATUS)
"""The samples that are published repeatedly: the newest of each can be queried, too."""

ESTOP = "yahboomd/estop"
ESTOP_RESET = "yahboomd/estop/reset"
ODOMETRY_RESET = "yahboomd/odometry/reset"
ODOMETRY_SET_POSE = "yahboomd/odometry/set_pose"
CONFIG = "yahboomd/config"
BOARD = "yahboomd/board"
BLACKBOX_SAVE = "yahboomd/blackbox/save"

ALIVE = "yahboomd/alive"

ROS_ODOM = "odom"
ROS_TF = "tf"
ROS_TF_STATIC = "tf_static"
ROS_JOINT_STATES = "joint_states"
ROS_IMU = "imu/data"
ROS_IMU_RAW = "imu/data_raw"
ROS_BATTERY_STATE = "battery_state"
ROS_DIAGNOSTICS = "diagnostics"
ROS_ESTOPPED = "estopped"
ROS_ROSOUT = "rosout"


def full_key(namespace: str, key: str) -> str:
    """The key as it goes over the bus: below ``namespace``, unless it begins with ``/``."""
    if key.startswith("/"):
        return key[1:]
    return f"{namespace}/{key}" if namespace else key


def holder_key(key: str, zid: str) -> str:
    """The key of the token that distinguishes one holder of ``key`` from another.

    Tokens of two sessions on one and the same key are one token to those who watch: the second is
    not announced, and when one of the two ends, the end is announced though the other lives on.
    """
    return f"{key}/{zid}"


def holder_of(key: str, holder: str) -> str | None:
    """The session in ``holder``, a key made by :func:`holder_key`; None for any other key."""
    prefix = f"{key}/"
    if not holder.startswith(prefix):
        return None
    zid = holder[len(prefix) :]
    return zid if zid and "/" not in zid else None
