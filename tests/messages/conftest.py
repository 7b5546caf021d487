"""Oracles for the tests of messages."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from ros_oracle import oracle

__all__ = ["oracle"]


def _header(stamp_ns: int, frame_id: str) -> dict[str, Any]:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


def _xyz(numbers: Any) -> dict[str, float]:
    return dict(zip("xyz", numbers, strict=True))


def _twist(numbers: Any) -> dict[str, Any]:
    return {"linear": _xyz(numbers[:3]), "angular": _xyz(numbers[3:])}


def _quaternion(numbers: Any) -> dict[str, float]:
    return dict(zip("xyzw", numbers, strict=True))


@pytest.fixture(scope="session")
def ros() -> SimpleNamespace:
    """Builders of the parts of ROS messages, as nested dicts."""
    return SimpleNamespace(header=_header, xyz=_xyz, twist=_twist, quaternion=_quaternion)
