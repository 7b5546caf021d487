from __future__ import annotations

import math
import random

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yahboomd.core.model import Pose2d
from yahboomd.core.odometry.integrator import SERIES_BELOW, Integrator, sinc

STEP_NS = 50_000_000


def drive(integrator, steps, step_ns=STEP_NS):
    totals = [0] * len(steps[0])
    for deltas in steps:
        totals = [total + delta for total, delta in zip(totals, deltas, strict=True)]
        integrator.integrate(tuple(deltas), tuple(totals), step_ns)
    return integrator.pose


def near(pose, other, tolerance):
    return (
        abs(pose.x - other.x) <= tolerance
        and abs(pose.y - other.y) <= tolerance
        and abs(pose.theta - other.theta) <= tolerance
    )


# The oracle


def oracle(steps, metres_per_tick, track_m):
    """The same formula with thirty digits, and heading from the integer totals."""
    mp = mpmath.mp.clone()
    mp.dps = 30
    tick, track = mp.mpf(metres_per_tick), mp.mpf(track_m)
    x = y = mp.mpf(0)
    left = right = 0
    before = None
    for a, b in steps:
        ds, turn = (a + b) * tick / 2, (b - a) * tick / track
        theta = (right - left) * tick / track
        left, right = left + a, right + b
        side = mp.mpf(0) if before is None else (before[1] * ds - turn * before[0]) / 12
        before = (ds, turn)
        half = turn / 2
        scale = mp.sin(half) / half if half else mp.mpf(1)
        cos, sin = mp.cos(theta + half) * scale, mp.sin(theta + half) * scale
        x += ds * cos - side * sin
        y += ds * sin + side * cos
    return x, y, (right - left) * tick / track


@pytest.mark.parametrize("metres", [200.0, pytest.param(1000.0, marks=pytest.mark.nightly)])
def test_a_kilometre_agrees_with_thirty_digits_to_a_nanometre(kit, metres):
    chance = random.Random(1)
    steps, gone, a, b = [], 0.0, 300.0, 300.0
    while gone < metres:
        a = min(600.0, max(0.0, a + chance.gauss(0.0, 30.0)))
        b = min(600.0, max(0.0, b + chance.gauss(0.0, 30.0)))
        steps.append((round(a), round(b)))
        gone += (steps[-1][0] + steps[-1][1]) / 2 * kit.tick_m
    motors = kit.motors()
    pose = drive(Integrator(kit.differential(), motors), steps)
    x, y, theta = oracle(steps, motors[0].metres_per_tick, kit.track_m)
    assert abs(pose.x - float(x)) < 1e-9
    assert abs(pose.y - float(y)) < 1e-9
    assert abs(pose.theta - float(theta)) < 1e-9


# The heading


def test_heading_is_never_off_by_more_than_two_ticks_over_the_track(kit):
    chance = np.random.default_rng(2)
    limit = 2.0 * kit.tick_m / kit.track_m
    worst = 0.0
    for _ in range(300):
        speeds = np.cumsum(chance.normal(0.0, 3.0, (60, 2)), axis=0) + chance.uniform(-30, 30, 2)
        travel = np.cumsum(speeds, axis=0)
        counts = np.floor(travel + chance.uniform(0.0, 1.0, 2)).astype(int)
        # The baseline is the first reading.
        counts -= counts[0]
        truth = (
            (travel[:, 1] - travel[:, 0] - travel[0, 1] + travel[0, 0]) * kit.tick_m / kit.track_m
        )
        integrator = Integrator(kit.differential(), kit.motors())
        last = (0, 0)
        for now, theta in zip(counts[1:].tolist(), truth[1:], strict=True):
            integrator.integrate((now[0] - last[0], now[1] - last[1]), tuple(now), STEP_NS)
            last = now
            worst = max(worst, abs(integrator.pose.theta - theta))
    assert 0.3 * limit < worst <= limit


def test_heading_does_not_creep_in_an_hour_of_spinning(kit):
    integrator = Integrator(kit.differential(), kit.motors())
    for n in range(1, 180_001):
        integrator.integrate((-23, 23), (-23 * n, 23 * n), 20_000_000)
    exact = mpmath.mpf(2 * 23 * 180_000) * mpmath.mpf(kit.tick_m) / mpmath.mpf(kit.track_m)
    assert abs(integrator.pose.theta - float(exact)) < 1e-9


def test_heading_is_not_wrapped(kit):
    pose = drive(Integrator(kit.differential(), kit.motors()), [(-100, 100)] * 100)
    assert pose.theta > 2.0 * math.pi


# Convergence

FINE = 1e13
"""Ticks of a turn that make counting as good as exact."""


def figure_of_eight(steps_count, seconds=40.0, spread=1.2):
    """Wheel travel of equal steps on a path whose curvature swings, and the path's true end."""
    omega = 2.0 * math.pi / (seconds / 2)

    def theta(t):
        return spread * np.sin(omega * t)

    speed = 1.0
    fine = 200_000
    t = np.linspace(0.0, seconds * 0.8, 2 * fine + 1)
    weights = np.ones_like(t)
    weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
    h = (t[1] - t[0]) / 3.0
    end = (
        speed * h * float(np.sum(weights * np.cos(theta(t)))),
        speed * h * float(np.sum(weights * np.sin(theta(t)))),
    )
    grid = np.linspace(0.0, seconds * 0.8, steps_count + 1)
    turns = np.diff(theta(grid))
    travel = speed * np.diff(grid)
    return travel, turns, end


def end_error(kit, steps_count, *, corrected):
    travel, turns, end = figure_of_eight(steps_count)
    motors = kit.motors(ticks=FINE)
    per_tick = motors[0].metres_per_tick
    half = turns * kit.track_m / 2.0
    left = np.round(np.cumsum((travel - half) / per_tick)).astype(object)
    right = np.round(np.cumsum((travel + half) / per_tick)).astype(object)
    integrator = Integrator(kit.differential(), motors, corrected=corrected)
    last = (0, 0)
    for a, b in zip(left, right, strict=True):
        now = (int(a), int(b))
        integrator.integrate((now[0] - last[0], now[1] - last[1]), now, STEP_NS)
        last = now
    return math.dist((integrator.pose.x, integrator.pose.y), end)


def euler_error(steps_count):
    travel, turns, end = figure_of_eight(steps_count)
    theta = np.concatenate(([0.0], np.cumsum(turns)[:-1]))
    return math.dist(
        (float(np.sum(travel * np.cos(theta))), float(np.sum(travel * np.sin(theta)))), end
    )


def slope(error):
    return math.log2(error(200) / error(400)), math.log2(error(400) / error(800))


def test_the_arc_converges_with_the_square_of_the_step(kit):
    assert slope(lambda n: end_error(kit, n, corrected=False)) == pytest.approx((2.0, 2.0), abs=0.1)


def test_the_corrected_arc_converges_with_the_third_power_at_least(kit):
    assert min(slope(lambda n: end_error(kit, n, corrected=True))) >= 3.0


def test_euler_converges_in_proportion(kit):
    assert slope(euler_error) == pytest.approx((1.0, 1.0), abs=0.1)


@pytest.mark.parametrize("pattern", [(10, 30), (20, 20), (30, 10, 20)])
def test_unequal_steps_are_corrected_as_well(kit, pattern):
    def error(*, corrected, honest=True):
        seconds, omega, speed = 20.0, 0.9, 0.8
        motors = kit.motors(ticks=FINE)
        per_tick = motors[0].metres_per_tick
        integrator = Integrator(kit.differential(), motors, corrected=corrected)
        t, last, n = 0.0, (0, 0), 0
        while t < seconds:
            step_ms = pattern[n % len(pattern)]
            t, n = t + step_ms * 1e-3, n + 1
            turned = 1.5 * math.sin(omega * t) * kit.track_m / 2.0
            now = (round((speed * t - turned) / per_tick), round((speed * t + turned) / per_tick))
            claimed_ns = step_ms * 1_000_000 if honest else 20_000_000
            integrator.integrate((now[0] - last[0], now[1] - last[1]), now, claimed_ns)
            last = now
        fine = np.linspace(0.0, t, 400_001)
        heading = 1.5 * np.sin(omega * fine)
        h = fine[1]
        end = (
            speed
            * h
            * float(np.sum(np.cos(heading)) - 0.5 * (np.cos(heading[0]) + np.cos(heading[-1]))),
            speed
            * h
            * float(np.sum(np.sin(heading)) - 0.5 * (np.sin(heading[0]) + np.sin(heading[-1]))),
        )
        return math.dist((integrator.pose.x, integrator.pose.y), end)

    assert error(corrected=True) < 0.05 * error(corrected=False)
    if len(set(pattern)) > 1:
        assert error(corrected=True) < 0.2 * error(corrected=True, honest=False)


def test_a_mecanum_base_is_integrated_to_the_same_order(kit):
    """Constant speed along a fixed direction of the room, while the base turns back and forth."""
    k = 0.2

    def error(count, *, corrected):
        motors = kit.motors((0, 1, 2, 3), ticks=FINE)
        per_tick = motors[0].metres_per_tick
        seconds = 8.0
        fine = 64
        t = np.linspace(0.0, seconds, count * fine + 1)
        theta = 1.1 * np.sin(1.3 * t)
        vx, vy = 0.5 * np.cos(theta), -0.5 * np.sin(theta)
        wz = 1.1 * 1.3 * np.cos(1.3 * t)
        rows = ((1, -1, -k), (1, 1, -k), (1, -1, k), (1, 1, k))
        travel = []
        for row in rows:
            rate = row[0] * vx + row[1] * vy + row[2] * wz
            h = t[1] - t[0]
            # Simpson over pairs, then every full step.
            pieces = h / 3.0 * (rate[:-1:2] + 4.0 * rate[1::2] + rate[2::2])
            travel.append(np.cumsum(pieces)[fine // 2 - 1 :: fine // 2])
        counts = np.round(np.array(travel).T / per_tick).astype(object)
        integrator = Integrator(kit.mecanum(k), motors, corrected=corrected)
        last = (0, 0, 0, 0)
        for row in counts:
            now = tuple(int(each) for each in row)
            deltas = tuple(b - a for a, b in zip(last, now, strict=True))
            integrator.integrate(deltas, now, STEP_NS)
            last = now
        return math.dist((integrator.pose.x, integrator.pose.y), (0.5 * seconds, 0.0))

    assert slope(lambda n: error(n, corrected=False)) == pytest.approx((2.0, 2.0), abs=0.15)
    assert min(slope(lambda n: error(n, corrected=True))) >= 3.0


# Invariances

wheel = st.integers(-80, 80)


@given(left=wheel, right=wheel, count=st.integers(1, 40))
def test_driving_an_arc_back_ends_where_it_began(kit, left, right, count):
    steps = [(left, right)] * count + [(-left, -right)] * count
    assert near(drive(Integrator(kit.differential(), kit.motors()), steps), Pose2d(), 1e-9)


@settings(max_examples=40)
@given(st.lists(st.tuples(wheel, wheel), min_size=1, max_size=40))
def test_any_path_driven_back_ends_where_it_began_without_correction(kit, steps):
    back = [(-a, -b) for a, b in reversed(steps)]
    integrator = Integrator(kit.differential(), kit.motors(), corrected=False)
    assert near(drive(integrator, steps + back), Pose2d(), 1e-9)


@given(left=wheel, right=wheel, parts=st.integers(2, 9))
def test_a_step_cut_in_equal_parts_ends_at_the_same_place(kit, left, right, parts):
    whole = drive(Integrator(kit.differential(), kit.motors()), [(left * parts, right * parts)])
    cut = drive(Integrator(kit.differential(), kit.motors()), [(left, right)] * parts)
    assert near(whole, cut, 1e-12)


def test_a_circle_closes(kit):
    # A hundred thousand ticks of a turn, so that whole circles are whole counts.
    track_m = 0.25
    motors = kit.motors(ticks=2.0 * math.pi * 0.0335 / (math.pi * track_m / 7000))
    pose = drive(Integrator(kit.differential(track_m), motors), [(300, 300 + 14)] * 1000)
    assert math.hypot(pose.x, pose.y) < 1e-9
    assert pose.theta == pytest.approx(2.0 * math.pi)


@settings(max_examples=40)
@given(st.lists(st.tuples(wheel, wheel), min_size=1, max_size=30), st.floats(-3, 3))
def test_the_path_does_not_depend_on_where_it_starts(kit, steps, theta):
    plain = drive(Integrator(kit.differential(), kit.motors()), steps)
    turned = Integrator(kit.differential(), kit.motors())
    turned.set_pose(Pose2d(x=1.0, y=-2.0, theta=theta), (0, 0))
    pose = drive(turned, steps)
    cos, sin = math.cos(theta), math.sin(theta)
    moved = Pose2d(
        x=1.0 + cos * plain.x - sin * plain.y,
        y=-2.0 + sin * plain.x + cos * plain.y,
        theta=theta + plain.theta,
    )
    assert near(pose, moved, 1e-9)


# Details


def test_sinc_has_no_step_where_the_series_begins():
    for x in (SERIES_BELOW, -SERIES_BELOW):
        below, above = math.nextafter(x, 0.0), math.nextafter(x, 2.0 * x)
        assert abs(sinc(below) - sinc(above)) < 3e-16
    assert sinc(0.0) == 1.0


def test_an_interruption_takes_no_correction_across_it(kit):
    paths = []
    for interrupted in (False, True):
        integrator = Integrator(kit.differential(), kit.motors())
        integrator.integrate((50, 10), (50, 10), STEP_NS)
        if interrupted:
            integrator.interrupt()
        integrator.integrate((10, 50), (60, 60), STEP_NS)
        paths.append(integrator.pose)
    plain = drive(
        Integrator(kit.differential(), kit.motors(), corrected=False), [(50, 10), (10, 50)]
    )
    assert paths[1] == plain
    assert paths[0] != plain


def test_a_set_pose_keeps_counting_from_there(kit):
    integrator = Integrator(kit.differential(), kit.motors())
    integrator.integrate((100, 100), (100, 100), STEP_NS)
    integrator.set_pose(Pose2d(x=5.0, y=6.0, theta=math.pi / 2), (100, 100))
    integrator.integrate((100, 100), (200, 200), STEP_NS)
    assert near(integrator.pose, Pose2d(x=5.0, y=6.0 + 100 * kit.tick_m, theta=math.pi / 2), 1e-12)
