"""Faults of a wheel: one value for every fault and its event.

Faults are values; nothing is raised. They are found by :mod:`~yahboomd.core.drive.wheel_follower`,
:mod:`~yahboomd.core.drive.follow_check` and :mod:`~yahboomd.core.drive.stop_watch`.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.model import Event

FaultKind: TypeAlias = Literal[
    "runaway_against",
    "runaway_fast",
    "turns_without_command",
    "no_counts",
    "not_started",
    "off_speed",
    "stop_not_obeyed",
    "rolled",
]
Action: TypeAlias = Literal["cut", "policy", "let_go", "report"]


class Fault(msgspec.Struct, frozen=True, kw_only=True):
    """Something wrong with a wheel.

    Attributes:
        kind: A stable word.
        motor: The motor by name; ``None`` if it concerns all of them.
        message: One sentence for a person, with the things to check.
        action: ``cut``: release the motors at once, in any configuration; ``policy``: act by
            ``faults.stall``; ``let_go``: the same, but until the next command alone; ``report``:
            report, and continue.
        certain: It lasted too long to be explained by lost or altered commands.
    """

    kind: FaultKind
    motor: str | None
    message: str
    action: Action
    commanded_m_s: float = 0.0
    measured_m_s: float = 0.0
    certain: bool = False

    def event(self) -> Event:
        return Event(
            kind=self.kind,
            severity="warning" if self.action in {"let_go", "report"} else "error",
            message=self.message,
            wheel=self.motor,
            data={
                "commanded_m_s": round(self.commanded_m_s, 4),
                "measured_m_s": round(self.measured_m_s, 4),
            },
        )
