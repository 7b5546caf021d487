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
the timeout of 0.5 s and a control period. A stopped process also has the watchdog's 2 s. In an
output stall the time starts when the port takes output again; an attachment of 15 MB has to arrive
first."""


class Latency(msgspec.Struct, frozen=True, kw_only=True):
    """One measurement.

    Attributes:
        seconds: From the fault to the frame.
        stalled_s: The part of it for which the machine stood still.
    """

    seconds: float
    stalled_s: float


class Ledger:
    """Counts the events of a run.

    Attributes:
        faults: Faults by kind.
        latencies: From a fault to the stop frame, by kind.
        stood_s: From a fault, or its end, to standing wheels, by kind.
        stops: Stops that the ground truth showed.
        drives: Faults after which it drove again.
        recovery_s: The time until it drove again.
        errors_m: Errors of the pose, stretch by stretch.
        errors_rad: Errors of the heading.
        worst_way: The stretch with the largest error of the pose.
        driven_m: The length of those stretches.
        uncertain: Stretches with lost travel that was reported.
        covered: Stretches with a larger error, within three of their standard deviations.
        apart: Stretches that are not compared, by reason.
        notes: Observations that are no failures.
        failures: Failures.
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
        """Record a stop frame."""
        self.latencies.setdefault(kind, []).append(Latency(seconds=seconds, stalled_s=stalled_s))

    def stopped(self, kind: str, seconds: float) -> None:
        """Record that the wheels stood."""
        self.stops += 1
        self.stood_s.setdefault(kind, []).append(seconds)

    def late(self, kind: str) -> list[Latency]:
        """Latencies over the budget."""
        most = BUDGETS_S.get(kind, float("inf"))
        return [each for each in self.latencies.get(kind, []) if each.seconds > most]

    def unexplained(self, kind: str) -> list[Latency]:
        """Latencies over the budget that the machine's own stalls do not explain."""
        most = BUDGETS_S.get(kind, float("inf"))
        return [each for each in self.late(kind) if each.seconds > most + each.stalled_s]


def quantile(values: Iterable[float], share: float) -> float:
    """The smallest value that this share of all does not exceed; NaN without any."""
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")
