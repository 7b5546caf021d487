"""Counts and latencies of the run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import msgspec

BUDGETS_S: dict[str, float] = {
    "e-stop": 0.050,
    "e-stop in a flood": 0.050,
    "flood of the e-stop's key": 0.050,
    "attachments": 0.050,
    "e-stop with an attachment": 0.500,
    "e-stop in an output stall": 0.050,
    "SIGTERM": 0.100,
    "SIGTERM in an output stall": 1.0,
    "another signal": 0.100,
    "frozen process: from its thaw": 0.100,
    "a speed, while answers are lost": 0.060,
    "command silence": 0.520,
    "client killed": 0.520,
    "SIGKILL": 1.0,
    "SIGSTOP": 3.0,
}
"""From the fault to the first stop frame on the wire; for silence, to the first decelerating one:
the timeout of 0.5 s and a control period. A stopped process has the watchdog's 2 s besides. In an
output stall it counts from the moment at which the port takes output again; an attachment of 15 MB
has to arrive first."""


class Latency(msgspec.Struct, frozen=True, kw_only=True):
    """One measurement.

    Attributes:
        seconds: From the fault to the frame.
        stalled_s: For how much of it the machine stood still.
    """

    seconds: float
    stalled_s: float


class Ledger:
    """Counts what happens.

    Attributes:
        faults: By kind.
        latencies: From a fault to the stop frame, by kind.
        stood_s: From a fault, or its end, to wheels that stand, by kind.
        stops: How many stops the ground truth showed.
        drives: After how many faults it drove again.
        recovery_s: How long that took.
        errors_m: Of the pose, stretch by stretch.
        errors_rad: Of the heading.
        worst_way: Where the pose erred most.
        driven_m: How far those stretches were.
        uncertain: Stretches in which travel was lost, and said so.
        covered: Stretches that erred by more than usual, within three of their standard deviations.
        apart: Stretches that are not compared, by reason.
        notes: What happened and is no failure.
        failures: What should not have happened.
        too_late: Latencies over their budget that no stall of the machine explains.
    """

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        self.latencies: dict[str, list[Latency]] = {}
        self.stood_s: dict[str, list[float]] = {}
        self.stops = 0
        self.drives = 0
        self.recovery_s: list[float] = []
        self.errors_m: list[float] = []
        self.errors_rad: list[float] = []
        self.driven_m = 0.0
        self.worst_way = "-"
        self.uncertain = 0
        self.covered = 0
        self.apart: Counter[str] = Counter()
        self.notes: Counter[str] = Counter()
        self.failures: list[str] = []
        self.too_late: list[str] = []

    def latency(self, kind: str, seconds: float, stalled_s: float) -> None:
        """A stop frame came."""
        self.latencies.setdefault(kind, []).append(Latency(seconds=seconds, stalled_s=stalled_s))

    def stopped(self, kind: str, seconds: float) -> None:
        """The wheels stood."""
        self.stops += 1
        self.stood_s.setdefault(kind, []).append(seconds)

    def late(self, kind: str) -> list[Latency]:
        """Measurements over the budget."""
        most = BUDGETS_S.get(kind, float("inf"))
        return [each for each in self.latencies.get(kind, []) if each.seconds > most]

    def unexplained(self, kind: str) -> list[Latency]:
        """The findings that the machine's own stalls do not explain."""
        most = BUDGETS_S.get(kind, float("inf"))
        return [each for each in self.late(kind) if each.seconds > most + each.stalled_s]


def quantile(values: Iterable[float], share: float) -> float:
    """A value that this share of all is not above; NaN without any."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")
