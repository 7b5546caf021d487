"""The gyro's rate about the vertical axis: integrated, and judged.

Law: the integral counts only while every sample since its last use is plausible. A gyro that was
silent, saturated or implausible must behave for a second before it is used again.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.model import Vector3

Problem: TypeAlias = Literal["silent", "saturated", "implausible", "unchecked"]

SILENT_NS = 150_000_000
"""Samples come every 40 ms; after this time without one the gyro is silent."""

PROBATION_NS = 1_000_000_000
"""The time that it must behave after a problem."""

FROZEN_SAMPLES = 50
"""This many identical samples come from a broken sensor: a working one has noise."""

SATURATED_SHARE = 0.99
"""A rate from this share of the limit on is saturated."""

CORNER = 0.03
"""The trapezoid between samples is wrong by this share of a bend of the rate."""

SHAKEN_SAMPLES = 250
SHAKEN_SHARE = 0.82
"""In motion, the shaking is averaged over this many samples. The share turns the product of two
opposite changes in a row into the variance of white noise."""


class GyroTurn(msgspec.Struct, frozen=True, kw_only=True):
    """The turn that the gyro measured up to a moment.

    Attributes:
        angle: The integral of its rate since it was first believed, radians.
        rate_rad_s: The latest rate.
        noise: Variance that the integral gained since the last call, rad^2.
        held: The possible error of the extrapolation beyond the latest sample, radians.
    """

    angle: float
    rate_rad_s: float
    noise: float
    held: float


class Gyro:
    """Integrates the rate of turn while its samples are plausible.

    Attributes:
        problem: Why it is not believed now; None while it is, or before its first sample.
        present: Whether it ever sent a sample.
        moving: Whether the wheels turn: only then the shaking is measured.
        shaken: The number of samples in the average of the shaking.
        shaking: Variance of the rate from vibration faster than the samples show, (rad/s)^2.
    """

    __slots__ = (
        "_angle _noise _stamp_ns _rates _same _latest _good_since_ns "
        "problem present moving shaken shaking"
    ).split()

    def __init__(self) -> None:
        self._angle = 0.0
        self._noise = 0.0
        self._stamp_ns = 0
        self._rates = (0.0, 0.0)  # of the latest sample and the one before
        self._same = 0
        self._latest: tuple[Vector3, Vector3] | None = None
        self._good_since_ns: int | None = None
        self.shaken = 0
        self.problem: Problem | None = None
        self.present = self.moving = False
        self.shaking = 0.0

    def accept(
        self,
        stamp_ns: int,
        rate_rad_s: float,
        *,
        shown: tuple[Vector3, Vector3],
        limit_rad_s: float,
        noise_rad_s: float,
    ) -> None:
        """Take in a sample.

        Args:
            stamp_ns: When it was measured.
            rate_rad_s: Counter-clockwise about the vertical axis.
            shown: All values of the sample, to detect a stuck sensor.
            limit_rad_s: The rate at which it saturates.
            noise_rad_s: Standard deviation of one sample.
        """
        self.present = True
        dt_ns = stamp_ns - self._stamp_ns
        if dt_ns <= 0:
            return
        self._same = self._same + 1 if shown == self._latest else 0
        self._latest = shown
        before, last = self._rates
        finite = math.isfinite(rate_rad_s)
        self._rates = (rate_rad_s if finite else 0.0, before)
        problem: Problem | None = None
        if not finite or self._same >= FROZEN_SAMPLES:
            problem = "implausible"
        elif abs(rate_rad_s) >= SATURATED_SHARE * limit_rad_s:
            problem = "saturated"
        elif dt_ns > SILENT_NS and self._stamp_ns:
            problem = "silent"
        self._stamp_ns = stamp_ns
        if problem is not None:
            self.refuse(problem)
            if problem == "silent":
                self._good_since_ns = stamp_ns
            return
        if self._good_since_ns is None:
            self._good_since_ns = stamp_ns
        if self.problem is not None and stamp_ns - self._good_since_ns >= PROBATION_NS:
            self.problem = None
        dt_s = dt_ns * 1e-9
        if dt_ns <= SILENT_NS:
            self._angle += 0.5 * (rate_rad_s + before) * dt_s
            bend = CORNER * (rate_rad_s - 2.0 * before + last)
            # A turn that begins or ends changes the rate one way; shaking changes it to and fro.
            shaking = SHAKEN_SHARE * max(0.0, (before - rate_rad_s) * (before - last))
            if self.moving:
                self.shaken = min(self.shaken + 1, SHAKEN_SAMPLES)
                self.shaking += (shaking - self.shaking) / self.shaken
                shaking = self.shaking
            noise = max(noise_rad_s * noise_rad_s, shaking)
            self._noise += (noise + bend * bend) * dt_s * dt_s

    def refuse(self, problem: Problem) -> None:
        """Reject it until it has behaved for ``PROBATION_NS``."""
        self.problem = problem
        self._good_since_ns = None

    @property
    def believed(self) -> bool:
        return self.present and self.problem is None and self._good_since_ns is not None

    def turn(self, now_ns: int) -> GyroTurn:
        """The turn measured up to now, believed or not.

        Args:
            now_ns: When the counters were sampled; the integral is extrapolated to it.
        """
        ahead_ns = now_ns - self._stamp_ns
        if self.present and self.problem is None and ahead_ns > SILENT_NS:
            self.refuse("silent")
        ahead_s = min(ahead_ns, SILENT_NS) * 1e-9
        rate, before = self._rates
        noise, self._noise = self._noise, 0.0
        return GyroTurn(
            angle=self._angle + rate * ahead_s,
            rate_rad_s=rate,
            noise=noise,
            held=0.5 * (rate - before) * ahead_s,
        )
