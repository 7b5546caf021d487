"""The keys of the bus: one name for each, all below one optional namespace.

yahboomd adds the namespace itself. Zenoh has a namespace of its own for a session, but clients that
watch for liveliness tokens below that namespace do not see them.

A key that begins with ``/`` is used as it is, outside the namespace: the keys of ROS 2's
middlewares (``/@ros2_lv/...``, ``/0/odom/...``) have their own rules for names.
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

READ_ONLY = (CONFIG, BOARD)
"""The services that change nothing: they answer queries with wildcards, too."""

ALIVE = "yahboomd/alive"


def own_key(key: str, person: str) -> str:
    """A service's key that is one person's alone, in a fleet."""
    return f"{key}/by/{person}"


def full_key(namespace: str, key: str) -> str:
    """The key as it goes over the bus: below ``namespace``, unless it begins with ``/``."""
    if key.startswith("/"):
        return key[1:]
    return f"{namespace}/{key}" if namespace else key


def holder_key(key: str, zid: str) -> str:
    """The key of the token that distinguishes one holder of ``key`` from another.

    A watcher sees tokens of two sessions on the same key as one: the second is not announced, and
    when either ends, the end is announced although the other still lives.
    """
    return f"{key}/{zid}"


def holder_of(key: str, holder: str) -> str | None:
    """The session in ``holder``, a key made by :func:`holder_key`; None for any other key."""
    prefix = f"{key}/"
    if not holder.startswith(prefix):
        return None
    zid = holder[len(prefix) :]
    return zid if zid and "/" not in zid else None
