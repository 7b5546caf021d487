"""The definitions of ROS 2 messages for recordings, with all types that they contain.

The texts are in ``definitions/``, in MCAP's schema encoding ``ros2msg``.
"""

from __future__ import annotations

from functools import cache
from importlib import resources


@cache
def definition(ros_type: str) -> str | None:
    """The definition of a type such as ``nav_msgs/msg/Odometry``; None if it is unknown."""
    name = ros_type.replace("/msg/", "_")
    file = resources.files("yahboomd.tools.record") / "definitions" / f"{name}.msg"
    return file.read_text(encoding="utf-8") if file.is_file() else None
