"""The factors from the poses of another sensor, whose place on the robot need not be known.

Closed form, after Censi, Franchi, Marchionni and Oriolo, *Simultaneous calibration of odometry and
sensor parameters for mobile robots*, IEEE T-RO 29 (2013), sections V.A and V.B: the turns of the
sensor are linear in the counts of both wheels; with these two factors known, its displacements are
linear in the track and in the mounting pose, whose direction is a unit vector.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from yahboomd.tools.calibrate.estimates.least_squares import SEEN, Fit, Unseen
from yahboomd.tools.calibrate.estimates.runs import Factors, Floats

GROUPS = 12
"""Parts of the recording; each is left out once, to see how far the result depends on it."""

LEAST_INTERVALS = 3 * GROUPS


class Tracks(NamedTuple):
    """The recorded samples.

    Attributes:
        time_s: The times of the wheels' readings, rising.
        left: Total travel of the left rim by its counts and its nominal radius, metres.
        right: The same of the right rim.
        separation_m: The nominal distance between the sides.
        pose_time_s: The times of the sensor's poses, on the same clock, rising.
        pose: The sensor's poses in any fixed frame: n rows of (x, y, heading), metres and radians.
    """

    time_s: Floats
    left: Floats
    right: Floats
    separation_m: float
    pose_time_s: Floats
    pose: Floats


class SensorPose(NamedTuple):
    """The sensor's pose on the robot, from the middle of the axle: metres, metres, radians."""

    x: float
    y: float
    heading: float


class _Interval(NamedTuple):
    left: Floats
    right: Floats
    moved: Floats


def fit_to_sensor(tracks: Tracks, *, interval_s: float = 1.0) -> tuple[Fit, SensorPose]:
    """The factors, with their deviation by leaving parts of the recording out (jackknife).

    Args:
        interval_s: Length of the pieces that are compared; short ones are noise, long ones slip.

    Raises:
        Unseen: Too little travel or turning in both directions to tell the factors apart.
    """
    intervals = _intervals(tracks, interval_s)
    if len(intervals) < LEAST_INTERVALS:
        raise Unseen("travel")
    factors, mounting, errors = _solve(intervals, tracks.separation_m)
    parts = [
        _solve(
            [each for index, each in enumerate(intervals) if index % GROUPS != part],
            tracks.separation_m,
        )[0]
        for part in range(GROUPS)
    ]
    spread = np.std(np.array(parts), axis=0) * np.sqrt(GROUPS - 1)
    std = Factors(*map(float, spread / np.array(factors)))
    return Fit(factors=factors, std=std, chi_squared=1.0, errors=errors), mounting


def _intervals(tracks: Tracks, interval_s: float) -> list[_Interval]:
    """Pieces between two poses of the sensor in which the wheels turned."""
    inside = (tracks.pose_time_s >= tracks.time_s[0]) & (tracks.pose_time_s <= tracks.time_s[-1])
    times, poses = tracks.pose_time_s[inside], tracks.pose[inside]
    found: list[_Interval] = []
    begin = 0
    while begin < len(times):
        end = int(np.searchsorted(times, times[begin] + interval_s))
        if end >= len(times):
            break
        between = tracks.time_s[(tracks.time_s > times[begin]) & (tracks.time_s < times[end])]
        at = np.concatenate(([times[begin]], between, [times[end]]))
        left = np.diff(np.interp(at, tracks.time_s, tracks.left))
        right = np.diff(np.interp(at, tracks.time_s, tracks.right))
        if np.abs(left).sum() + np.abs(right).sum() > 0.0:
            found.append(_Interval(left, right, _relative(poses[begin], poses[end])))
        begin = end
    return found


def _relative(before: Floats, after: Floats) -> Floats:
    """The second pose as seen from the first; the heading within half a turn."""
    dx, dy, turn = after - before
    cos, sin = np.cos(before[2]), np.sin(before[2])
    turn = (turn + np.pi) % (2.0 * np.pi) - np.pi
    return np.array([cos * dx + sin * dy, -sin * dx + cos * dy, turn])


def _solve(
    intervals: list[_Interval], separation_m: float
) -> tuple[Factors, SensorPose, tuple[tuple[float, ...], ...]]:
    counts = np.array([[each.left.sum(), each.right.sum()] for each in intervals])
    turns = np.array([each.moved[2] for each in intervals])
    # A piece may contain more than half a turn: take whole turns from the counts.
    nominal = (counts[:, 1] - counts[:, 0]) / separation_m
    turns = turns + 2.0 * np.pi * np.round((nominal - turns) / (2.0 * np.pi))
    square = counts.T @ counts
    if np.linalg.eigvalsh(square)[0] < SEEN * np.trace(square):
        raise Unseen("ratio")
    by_left, by_right = np.linalg.solve(square, counts.T @ turns)
    if not by_left < 0.0 < by_right:
        raise Unseen("track")
    rows = []
    for each, turn in zip(intervals, turns, strict=True):
        # The path of the axle's middle, in units of the track.
        step = by_left * each.left + by_right * each.right
        heading = np.cumsum(step) - step / 2.0
        chord = (by_right * each.right - by_left * each.left) / 2.0 * np.sinc(step / (2 * np.pi))
        along, across = float(chord @ np.cos(heading)), float(chord @ np.sin(heading))
        x, y, _ = each.moved
        cos, sin = 1.0 - np.cos(turn), np.sin(turn)
        rows += [[-along, cos, sin, x, -y], [-across, -sin, cos, y, x]]
    system = np.array(rows)
    whole = system.T @ system
    lengths, mixed, direction = whole[:3, :3], whole[:3, 3:], whole[3:, 3:]
    size = np.sqrt(np.diag(lengths))
    if not size.all() or np.linalg.eigvalsh(lengths / np.outer(size, size))[0] < SEEN:
        raise Unseen("track")
    to_lengths = -np.linalg.solve(lengths, mixed)
    unit = np.linalg.eigh(direction + mixed.T @ to_lengths)[1][:, 0]
    track_m, x, y = to_lengths @ unit
    if track_m < 0.0:
        unit, track_m, x, y = -unit, -track_m, -x, -y
    left, right = -by_left * track_m, by_right * track_m
    errors = system @ np.array([track_m, x, y, *unit])
    return (
        Factors(
            scale=float(left + right) / 2.0,
            ratio=float(right / left),
            track=float(track_m) / separation_m,
        ),
        SensorPose(float(x), float(y), float(np.arctan2(unit[1], unit[0]))),
        tuple((float(a), float(b)) for a, b in errors.reshape(-1, 2)),
    )
