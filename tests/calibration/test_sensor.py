"""The closed form against another sensor: exact without noise, and refusing what hides."""

from __future__ import annotations

import math

import numpy as np
import pytest

from yahboomd.tools.calibrate.estimates.least_squares import Unseen
from yahboomd.tools.calibrate.estimates.runs import Factors, Run, path
from yahboomd.tools.calibrate.estimates.sensor import SensorPose, Tracks, fit_to_sensor

TRUE = Factors(scale=1.03, ratio=0.99, track=1.08)
MOUNTED = SensorPose(0.1, -0.03, 0.4)
TRACK_M = 0.17


def drive(
    speed, turning, *, slip: float = 0.0, sensor: float = 0.0, minutes: float = 2.0
) -> Tracks:
    """A recording of wheels at 50 Hz and of a sensor at 10 Hz, in a frame of its own."""
    rng = np.random.default_rng(7)
    time_s = np.arange(0.0, 60.0 * minutes, 0.02)
    v, w = (
        np.broadcast_to(speed(time_s), time_s.shape),
        np.broadcast_to(turning(time_s), time_s.shape),
    )
    left, right = (v - w * TRACK_M / 2) * 0.02, (v + w * TRACK_M / 2) * 0.02

    def rolled(travel, factor):
        return factor * travel + slip * rng.normal(size=len(travel)) * np.sqrt(np.abs(travel))

    true = Run("pose", rolled(left, TRUE.left), rolled(right, TRUE.right), TRACK_M, (), ())
    x, y, heading = path(true, Factors(track=TRUE.track))
    cos, sin = np.cos(heading), np.sin(heading)
    seen = np.stack(
        (
            x + cos * MOUNTED.x - sin * MOUNTED.y,
            y + sin * MOUNTED.x + cos * MOUNTED.y,
            heading + MOUNTED.heading,
        ),
        axis=1,
    )[::5]
    seen += sensor * rng.normal(size=seen.shape)
    # The sensor's frame lies anywhere, and its headings are wrapped.
    seen[:, 2] = (seen[:, 2] + 2.0 + np.pi) % (2.0 * np.pi) - np.pi
    around = np.array([[math.cos(2.0), math.sin(2.0)], [-math.sin(2.0), math.cos(2.0)]])
    seen[:, :2] = seen[:, :2] @ around + (3.0, -1.0)
    times = np.concatenate((time_s, [time_s[-1] + 0.02]))
    total = [np.concatenate(([0.0], np.cumsum(each))) for each in (left, right)]
    return Tracks(times, *total, TRACK_M, times[::5][: len(seen)], seen)


def curvy(t):
    return 1.0 * np.sin(t / 3.0) + 0.3


def test_without_noise_size_and_mounting_are_exact() -> None:
    found, mounting = fit_to_sensor(drive(lambda t: 0.2 + 0.1 * np.sin(t / 7.0), curvy))
    assert found.factors == pytest.approx(TRUE, rel=1e-6)
    assert mounting == pytest.approx(MOUNTED, abs=1e-6)


def test_with_noise_the_errors_are_within_the_deviations_that_it_names() -> None:
    noisy = drive(lambda t: 0.2 + 0.1 * np.sin(t / 7.0), curvy, slip=0.003, sensor=0.002)
    found, mounting = fit_to_sensor(noisy)
    for value, true, std in zip(found.factors, TRUE, found.std, strict=True):
        assert abs(value / true - 1.0) < 4.0 * std < 0.03
    assert mounting.x == pytest.approx(MOUNTED.x, abs=0.005)


@pytest.mark.parametrize(
    ("speed", "turning", "part"),
    [
        (lambda t: 0.2 + 0.0 * t, lambda t: 0.0 * t, "ratio|track"),
        (lambda t: 0.0 * t, lambda t: 0.0 * t, "travel"),
    ],
    ids=["straight", "standing"],
)
def test_a_drive_that_hides_a_factor_is_refused(speed, turning, part: str) -> None:
    with pytest.raises(Unseen, match=part):
        fit_to_sensor(drive(speed, turning))


def test_too_short_a_recording_is_refused() -> None:
    with pytest.raises(Unseen, match="travel"):
        fit_to_sensor(drive(lambda t: 0.2 + 0.0 * t, curvy, minutes=0.3))
