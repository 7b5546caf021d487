"""The ground truth: the simulated robot's true pose, to compare odometry with.

A file of JSON lines, one sample every 10 ms. Stamps are the simulation's time: on a pty
CLOCK_MONOTONIC, which other processes of the same machine share.
"""

from __future__ import annotations

import bisect
from pathlib import Path

import msgspec

from yahboomd.core.model import Counts, Pose2d
from yahboomd.simulation.lines import LinesWriter, read_lines

FLUSH_SAMPLES = 20
"""Samples between two flushes: a killed simulator loses at most these, a reader waits for them."""


class TruthSample(msgspec.Struct, frozen=True, kw_only=True):
    """The robot at one moment.

    Attributes:
        t_ns: Monotonic nanoseconds.
        theta: Radians, not wrapped.
        vx: m/s, in the base frame.
        vy: m/s, in the base frame.
        wz: rad/s.
        speed_m_s: True rim speed per motor, in the order of the wiring.
        travel_m: True rim travel per motor since the start.
        ticks: The board's counters, positions 1 to 4, as its latest interrupt left them.
    """

    t_ns: int
    x: float
    y: float
    theta: float
    vx: float
    vy: float
    wz: float
    speed_m_s: tuple[float, ...]
    travel_m: tuple[float, ...]
    ticks: Counts

    @property
    def pose(self) -> Pose2d:
        """The pose alone."""
        return Pose2d(x=self.x, y=self.y, theta=self.theta)


class TruthWriter(LinesWriter):
    """Writes samples to a file; :meth:`write` fits a robot's ``on_truth``."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, flush_every=FLUSH_SAMPLES)


def read_truth(path: Path) -> list[TruthSample]:
    """All of it, oldest first; see :func:`~yahboomd.simulation.lines.read_lines`."""
    return read_lines(path, TruthSample)


def pose_at(samples: list[TruthSample], t_ns: int) -> Pose2d:
    """The pose at a moment between samples, by linear interpolation.

    Over 10 ms this errs by less than acceleration / 8 x (10 ms)^2: 0.1 mm at 10 m/s^2.

    Raises:
        ValueError: ``t_ns`` lies outside the samples.
    """
    after = bisect.bisect_left(samples, t_ns, key=lambda sample: sample.t_ns)
    if after < len(samples) and samples[after].t_ns == t_ns:
        return samples[after].pose
    if not 0 < after < len(samples):
        raise ValueError(f"no truth at {t_ns}")
    old, new = samples[after - 1], samples[after]
    share = (t_ns - old.t_ns) / (new.t_ns - old.t_ns)
    return Pose2d(
        x=old.x + share * (new.x - old.x),
        y=old.y + share * (new.y - old.y),
        theta=old.theta + share * (new.theta - old.theta),
    )
