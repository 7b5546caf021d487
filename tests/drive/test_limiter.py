from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.limiter import AxisCaps, Limiter
from yahboomd.core.model import STANDSTILL, Twist2d

DEFAULT = AxisCaps(velocity=1.0, acceleration=2.5, deceleration=5.0)
RATES = st.none() | st.floats(0.1, 20.0)
LIMITS = st.builds(
    AxisCaps,
    velocity=st.none() | st.floats(0.0, 3.0),
    acceleration=RATES,
    deceleration=RATES,
    jerk=st.none() | st.floats(0.5, 200.0),
)
STEPS = st.lists(st.tuples(st.floats(-3.0, 3.0), st.floats(0.0005, 0.1)), min_size=1, max_size=40)
EPS = 1e-9


def limiter(limits: AxisCaps) -> Limiter:
    return Limiter(limits, AxisCaps())


def clamped(wish: float, limits: AxisCaps) -> float:
    most = math.inf if limits.velocity is None else limits.velocity
    return max(-most, min(most, wish))


@given(LIMITS, STEPS)
def test_every_step_ends_between_where_it_started_and_the_wish(
    limits: AxisCaps, steps: list[tuple[float, float]]
) -> None:
    ramp = limiter(limits)
    for wish, dt_s in steps:
        before = ramp.current.vx
        after = ramp.limit(Twist2d(vx=wish), dt_s).vx
        goal = clamped(wish, limits)
        assert min(before, goal) <= after <= max(before, goal)


@given(LIMITS, STEPS)
def test_the_speed_grows_by_acceleration_and_falls_by_deceleration(
    limits: AxisCaps, steps: list[tuple[float, float]]
) -> None:
    ramp = limiter(limits)
    faster = math.inf if limits.acceleration is None else limits.acceleration
    slower = math.inf if limits.deceleration is None else limits.deceleration
    for wish, dt_s in steps:
        before = ramp.current.vx
        after = ramp.limit(Twist2d(vx=wish), dt_s).vx
        # Through zero, the step is shared between the two: how long would it have taken at least?
        down = abs(before) if before * after < 0 else max(0.0, abs(before) - abs(after))
        up = abs(after) if before * after < 0 else max(0.0, abs(after) - abs(before))
        assert down / slower + up / faster <= dt_s + EPS


@given(LIMITS, STEPS)
def test_the_velocity_limit_holds(limits: AxisCaps, steps: list[tuple[float, float]]) -> None:
    ramp = limiter(limits)
    for wish, dt_s in steps:
        assert abs(ramp.limit(Twist2d(vx=wish), dt_s).vx) <= (limits.velocity or math.inf) or (
            limits.velocity == 0.0 and ramp.current.vx == 0.0
        )


@given(st.floats(0.5, 100.0), st.floats(0.5, 10.0), st.floats(-2.0, 2.0), st.floats(0.001, 0.05))
def test_the_jerk_limit_holds_on_the_way_to_a_wish(
    jerk: float, rate: float, wish: float, dt_s: float
) -> None:
    ramp = limiter(AxisCaps(acceleration=rate, deceleration=rate, jerk=jerk))
    speeds = [0.0, 0.0]
    for _ in range(200):
        speeds.append(ramp.limit(Twist2d(vx=wish), dt_s).vx)
    for v0, v1, v2 in zip(speeds, speeds[1:], speeds[2:], strict=False):
        assert abs(v2 - 2 * v1 + v0) <= jerk * dt_s * dt_s * (1 + 1e-6) + 1e-12


@given(
    st.floats(0.5, 100.0),
    st.floats(0.5, 10.0),
    st.floats(-1.5, 1.5),
    st.lists(st.floats(0.001, 0.1), min_size=5, max_size=5),
)
def test_jerk_limited_motion_stops_for_good_without_swinging(
    jerk: float, rate: float, start: float, lengths: list[float]
) -> None:
    ramp = limiter(AxisCaps(acceleration=rate, deceleration=rate, jerk=jerk))
    ramp.reset(Twist2d(vx=start))
    # Building the rate up and taking it back costs at most 2 sqrt(v / j), or v / a + a / j.
    bound_s = 2.0 * math.sqrt(abs(start) / jerk) + abs(start) / rate + rate / jerk
    elapsed_s = 0.0
    for dt_s in itertools.cycle(lengths):
        if elapsed_s > 1.5 * bound_s + 1.0:
            break
        speed = ramp.limit(STANDSTILL, dt_s).vx
        elapsed_s += dt_s
        assert speed * start >= 0.0
    assert ramp.current.vx == 0.0


def test_a_stop_in_the_middle_of_speeding_up_never_speeds_up_first() -> None:
    ramp = limiter(AxisCaps(acceleration=2.5, deceleration=5.0, jerk=10.0))
    for _ in range(20):
        ramp.limit(Twist2d(vx=1.0), 0.02)
    speeds = [ramp.current.vx] + [ramp.limit(STANDSTILL, 0.02).vx for _ in range(60)]
    assert speeds[0] > 0.2
    assert all(later <= earlier for earlier, later in itertools.pairwise(speeds))
    assert speeds[-1] == 0.0


def test_a_wish_that_one_step_of_jerk_reaches_is_reached_in_one_step() -> None:
    ramp = limiter(AxisCaps(jerk=10.0))
    assert ramp.limit(Twist2d(vx=0.1), 0.1).vx == 0.1


def test_after_a_wish_that_is_met_early_the_rate_is_zero() -> None:
    ramp = limiter(AxisCaps(acceleration=2.5, jerk=10.0))
    for _ in range(20):
        near = ramp.limit(Twist2d(vx=5.0), 0.02).vx + 0.01
    assert ramp.limit(Twist2d(vx=near), 0.02).vx == near
    assert ramp.limit(Twist2d(vx=5.0), 0.02).vx == pytest.approx(near + 10.0 * 0.02 * 0.02)


def test_the_default_limits_reach_full_speed_in_their_time_and_stop_in_half_of_it() -> None:
    ramp = limiter(DEFAULT)
    up = [ramp.limit(Twist2d(vx=2.0), 0.02).vx for _ in range(20)]
    assert up == pytest.approx([0.05 * n for n in range(1, 21)])
    down = [ramp.limit(STANDSTILL, 0.02).vx for _ in range(10)]
    assert down == pytest.approx([1.0 - 0.1 * n for n in range(1, 11)], abs=1e-12)


def test_turning_round_decelerates_to_zero_before_it_accelerates() -> None:
    ramp = limiter(DEFAULT)
    ramp.reset(Twist2d(vx=0.15))
    speeds = [ramp.limit(Twist2d(vx=-1.0), 0.02).vx for _ in range(3)]
    # 0.15 m/s take 30 ms at 5 m/s^2; the other 10 ms of the second step go backward at 2.5.
    assert speeds == pytest.approx([0.05, -0.025, -0.075])


def test_missing_limits_let_everything_through_at_once() -> None:
    ramp = limiter(AxisCaps())
    assert ramp.limit(Twist2d(vx=5.0, vy=-4.0, wz=9.0), 1e-6) == Twist2d(vx=5.0, vy=-4.0, wz=9.0)
    assert ramp.limit(Twist2d(vx=-5.0), 1e-6) == Twist2d(vx=-5.0)
    assert ramp.limit(Twist2d(vx=1e300, wz=-1e300), 1e-6) == Twist2d(vx=1e9, wz=-1e9)


@pytest.mark.parametrize("axis", ["vx", "vy", "wz"])
def test_it_is_halted_unless_an_axis_moves(axis: str) -> None:
    limiter = Limiter(AxisCaps(), AxisCaps())
    assert limiter.halted
    limiter.reset(Twist2d(**{axis: 0.1}))
    assert not limiter.halted
    limiter.halt()
    assert limiter.halted


def test_each_axis_has_its_own_limits() -> None:
    ramp = Limiter(DEFAULT, AxisCaps(acceleration=12.0))
    moved = ramp.limit(Twist2d(vx=1.0, vy=-1.0, wz=3.0), 0.02)
    assert (moved.vx, moved.vy, moved.wz) == pytest.approx((0.05, -0.05, 0.24))


@pytest.mark.parametrize("dt_s", [0.0, -1.0])
@pytest.mark.parametrize("jerk", [None, 10.0])
def test_a_step_of_no_time_changes_nothing(dt_s: float, jerk: float | None) -> None:
    ramp = limiter(AxisCaps(acceleration=2.5, jerk=jerk))
    before = ramp.limit(Twist2d(vx=1.0), 0.02)
    assert ramp.limit(Twist2d(vx=-1.0), dt_s) == before


def test_halt_stands_at_once_and_forgets_the_acceleration() -> None:
    ramp = limiter(AxisCaps(acceleration=2.5, jerk=10.0))
    for _ in range(10):
        ramp.limit(Twist2d(vx=1.0), 0.02)
    assert ramp.halt() == STANDSTILL
    assert ramp.limit(Twist2d(vx=1.0), 0.02).vx == pytest.approx(10.0 * 0.02 * 0.02, rel=0.5)


def test_a_long_pause_does_not_let_the_next_command_through_whole() -> None:
    ramp = limiter(DEFAULT)
    assert ramp.limit(Twist2d(vx=1.0), 10.0).vx == pytest.approx(0.25)


@pytest.mark.parametrize("wish", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("limits", [DEFAULT, AxisCaps(jerk=5.0, deceleration=5.0)])
def test_a_wish_that_is_no_number_asks_for_standstill(wish: float, limits: AxisCaps) -> None:
    ramp = limiter(limits)
    ramp.reset(Twist2d(vx=0.5))
    for _ in range(100):
        speed = ramp.limit(Twist2d(vx=wish), 0.02).vx
        assert 0.0 <= speed <= 0.5
    assert speed == 0.0


@given(LIMITS, st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=8))
def test_speeds_stay_numbers_whatever_is_wished(limits: AxisCaps, wishes: list[float]) -> None:
    ramp = limiter(limits)
    for wish in wishes:
        assert math.isfinite(ramp.limit(Twist2d(vx=wish), 0.02).vx)


def test_a_velocity_limit_of_zero_keeps_the_axis_still() -> None:
    assert limiter(AxisCaps(velocity=0.0)).limit(Twist2d(vx=1.0), 0.1).vx == 0.0


def test_a_wish_beyond_the_velocity_limit_is_known_to_be_clipped() -> None:
    limiter = Limiter(AxisCaps(velocity=0.5), AxisCaps(velocity=2.0))
    assert not limiter.clips(Twist2d(vx=0.5, vy=-0.5, wz=-2.0))
    assert limiter.clips(Twist2d(vx=-0.51))
    assert limiter.clips(Twist2d(vy=0.51))
    assert limiter.clips(Twist2d(wz=2.1))
    assert not Limiter(AxisCaps(), AxisCaps()).clips(Twist2d(vx=100.0, wz=100.0))
