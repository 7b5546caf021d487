"""Oracles for the tests of messages."""

from __future__ import annotations

from ros_oracle import oracle, ros

__all__ = ["oracle", "ros"]
