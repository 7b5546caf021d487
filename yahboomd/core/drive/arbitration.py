"""The values of arbitration: sources, refused commands, and decisions.

:mod:`~yahboomd.core.drive.arbiter` decides.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.model import STANDSTILL, Twist2d

Reason: TypeAlias = Literal[
    "unknown_source",
    "not_finite",
    "too_fast",
    "stale",
    "out_of_order",
    "from_the_future",
    "backlog",
    "after_pause",
    "lower_priority",
    "not_standing",
    "battery_empty",
]
Why: TypeAlias = Literal["driving", "zero_command", "ended", "timed_out", "revoked", "no_command"]


class AllowedSource(msgspec.Struct, frozen=True, kw_only=True):
    """A source of commands that may drive.

    Attributes:
        name: The key below the namespace, such as ``cmd_vel``.
        priority: The larger number wins.
        timeout_s: The time for which one of its commands is valid.
    """

    name: str
    priority: int
    timeout_s: float = 0.5


class CommandRefused(msgspec.Struct, frozen=True, kw_only=True):
    """The command has no effect.

    Attributes:
        reason: A stable word, also the key in the counters.
        detail: A sentence for a person.
    """

    reason: Reason
    detail: str


class Decision(msgspec.Struct, frozen=True, kw_only=True):
    """The motion that the wheels should make now, and the source that decides it.

    Attributes:
        twist: The wish, not limited yet.
        driver: The source in control; ``None`` for none.
        since_ns: When the driver took control; without a driver, since when there is none
            (``None``: from the start).
        ramp: Whether the way to ``twist`` may be a ramp; if not, the wheels stand at once.
        why: The cause of the motion, in one word.
        source: The source of the last command in effect; with ``no_command`` the source that drove
            when its client left.
        age_ns: The time since that command was given, or since that client left.
    """

    twist: Twist2d = STANDSTILL
    driver: str | None = None
    since_ns: int | None = None
    ramp: bool = True
    why: Why = "no_command"
    source: str | None = None
    age_ns: int | None = None
