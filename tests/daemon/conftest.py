"""An application on the bus of a daemon in a process of its own."""

from __future__ import annotations

from real_robot import client, real_robot
from zenoh_fixtures import zenoh_app

__all__ = ["client", "real_robot", "zenoh_app"]
