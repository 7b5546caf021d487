from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yahboomd.core.drive.kinematics import mecanum
from yahboomd.core.model import Pose2d
from yahboomd.core.odometry.covariance import (
    SIDEWAYS_M_S,
    TURN_VARIANCE_MAX,
    Covariance,
    with_heading,
)
from yahboomd.core.odometry.integrator import Arc, Integrator
from yahboomd.core.odometry.velocity import Window

STEP_NS = 20_000_000
ARC = Arc(0.01, 0.0, 1.0, 0.0, 0.1)


def matrix(nine):
    return np.array(nine).reshape(3, 3)


class Base:
    def __init__(self, kinematics, motors, **options):
        self.integrator = Integrator(kinematics, motors)
        self.covariance = Covariance(kinematics, motors, **options)
        self.totals = (0,) * len(motors)

    def step(self, *deltas):
        self.totals = tuple(a + b for a, b in zip(self.totals, deltas, strict=True))
        arc = self.integrator.integrate(deltas, self.totals, STEP_NS)
        self.covariance.propagate(deltas, arc)
        return arc

    @property
    def pose(self):
        return matrix(self.covariance.pose)


@pytest.fixture
def base(kit):
    return Base(kit.differential(), kit.motors())


def check_sound(covariance):
    assert np.array_equal(covariance, covariance.T)
    scale = max(1e-12, float(np.max(np.abs(covariance))))
    assert np.min(np.linalg.eigvalsh(covariance)) >= -1e-12 * scale


wheel = st.integers(-100, 100)


@settings(max_examples=40)
@given(st.lists(st.tuples(wheel, wheel), min_size=1, max_size=60))
def test_covariance_is_sound_and_its_volume_never_shrinks(kit, steps):
    base = Base(kit.differential(), kit.motors())
    volume, heading = np.linalg.det(base.pose), base.pose[2, 2]
    for step in steps:
        base.step(*step)
        check_sound(base.pose)
        assert base.pose[2, 2] >= heading
        now = np.linalg.det(base.pose)
        assert now >= volume * (1.0 - 1e-6)
        volume, heading = now, base.pose[2, 2]


@settings(max_examples=40)
@given(st.lists(st.tuples(wheel, wheel, wheel, wheel), min_size=1, max_size=40))
def test_that_of_a_mecanum_base_is_sound_as_well(kit, steps):
    base = Base(kit.mecanum(), kit.motors((0, 1, 2, 3)))
    for step in steps:
        base.step(*step)
        check_sound(base.pose)


def test_variance_grows_with_the_distance_a_wheel_rolled_not_with_the_time(kit):
    variances = []
    for count, ticks in ((100, 50), (1000, 5)):
        base = Base(kit.differential(), kit.motors(), noise_m=1e-5)
        before = base.pose
        for _ in range(count):
            base.step(ticks, ticks)
        variances.append((base.pose - before)[2, 2])
    rolled_m = 5000 * kit.tick_m
    assert variances[0] == pytest.approx(2 * 1e-5 * rolled_m / kit.track_m**2)
    assert variances[1] == pytest.approx(variances[0])


def test_turning_on_the_spot_is_rolling_as_well(base):
    before = base.pose
    for _ in range(100):
        base.step(-30, 30)
    assert (base.pose - before)[2, 2] > 0.0


def test_standing_adds_nothing(base):
    before = base.covariance.pose
    for _ in range(100):
        base.step(0, 0)
    assert base.covariance.pose == before


def test_an_error_of_heading_becomes_one_of_place(base):
    for _ in range(1000):
        base.step(50, 50)
    covariance = base.pose
    assert covariance[1, 1] > 10 * covariance[0, 0]
    assert covariance[1, 2] > 0.0


def test_two_motors_of_a_side_are_one_wheel(kit):
    two = Base(kit.differential(), kit.motors())
    four = Base(kit.differential(), kit.motors((0, 0, 1, 1)))
    before = two.pose, four.pose
    for _ in range(100):
        two.step(40, 50)
        four.step(40, 40, 50, 50)
    assert np.allclose(two.pose - before[0], four.pose - before[1], rtol=0.05)


def test_the_jacobians_are_the_derivatives_of_the_arc(kit):
    """Push one wheel a little and see the change of the pose; compute covariance from those."""
    motors = kit.motors()

    def end(left, right):
        integrator = Integrator(kit.differential(), motors, corrected=False)
        integrator.integrate((left, right), (left, right), STEP_NS)
        pose = integrator.pose
        return np.array([pose.x, pose.y, pose.theta])

    noise_m = 1e-5
    base = Base(kit.differential(), motors, noise_m=noise_m)
    floor = base.pose
    left, right = 400, 700
    arc = base.step(left, right)
    columns = np.column_stack(
        [
            (end(left + 1, right) - end(left - 1, right)) / (2 * kit.tick_m),
            (end(left, right + 1) - end(left, right - 1)) / (2 * kit.tick_m),
        ]
    )
    process = (
        columns @ np.diag([noise_m * left * kit.tick_m, noise_m * right * kit.tick_m]) @ columns.T
    )
    moved = np.array([[1.0, 0.0, -arc.dy], [0.0, 1.0, arc.dx], [0.0, 0.0, 1.0]])
    assert np.allclose(base.pose, moved @ floor @ moved.T + process, rtol=2e-3, atol=1e-12)


def test_a_start_is_known_to_a_tick(base, kit):
    heading = math.sqrt(base.pose[2, 2])
    assert 0.4 * kit.tick_m / kit.track_m < heading < 2.0 * kit.tick_m / kit.track_m


@given(st.floats(-4, 4))
def test_a_set_pose_takes_its_covariance_and_the_floor(kit, theta):
    covariance = Covariance(kit.differential(), kit.motors())
    given_nine = (4e-4, 1e-4, 0.0, 1e-4, 9e-4, 0.0, 0.0, 0.0, 1e-3)
    covariance.set_pose(theta, given_nine)
    rest = matrix(covariance.pose) - matrix(given_nine)
    check_sound(matrix(covariance.pose))
    assert np.all(np.abs(rest) < 1e-5)
    assert np.min(np.linalg.eigvalsh(rest)) > -1e-15


def test_what_was_not_counted_may_have_been_anything(base):
    before = base.pose
    base.covariance.lose(0.3)
    growth = base.pose - before
    assert growth[0, 0] == growth[1, 1] == pytest.approx(0.03)
    assert growth[2, 2] > 0.0
    base.covariance.lose(1e6)
    assert base.pose[2, 2] < before[2, 2] + growth[2, 2] + 1.01 * TURN_VARIANCE_MAX


def test_the_twist_is_known_to_a_tick_of_its_window(kit):
    covariance = Covariance(kit.differential(), kit.motors())
    short = matrix(covariance.twist(Window(20_000_000, (0, 0))))
    long = matrix(covariance.twist(Window(100_000_000, (0, 0))))
    assert math.sqrt(short[0, 0]) == pytest.approx(kit.tick_m / math.sqrt(12.0) / 0.020)
    assert short[0, 0] == pytest.approx(25 * long[0, 0])
    for each in (short, long):
        check_sound(each)
        assert np.all(np.diag(each) > 0.0)


def test_a_twist_that_is_not_known_says_so(kit):
    covariance = Covariance(kit.differential(), kit.motors())
    assert covariance.twist(Window(0, (0, 0)))[0] == 1.0


def spread_of_wheels(kit, kinematics, deltas, noise_m):
    """Covariance of the body's travel over a window, from that of each wheel's travel."""
    forward = np.array(kinematics.forward)
    rolled = np.abs(np.array(deltas)) * kit.tick_m
    return forward @ np.diag(noise_m * rolled + kit.tick_m**2 / 6.0) @ forward.T


BASES = [("differential", (0, 1), (300, 500)), ("mecanum", (0, 1, 2, 3), (300, -200, 400, 100))]


@pytest.mark.parametrize(("name", "wheels", "deltas"), BASES)
def test_the_twist_is_as_unsure_as_its_wheels_and_moves_sideways_only_where_it_can(
    kit, name, wheels, deltas
):
    kinematics = getattr(kit, name)()
    covariance = Covariance(kinematics, kit.motors(wheels), noise_m=1e-5)
    expected = spread_of_wheels(kit, kinematics, deltas, 1e-5) / 0.05**2
    if name == "differential":
        expected[1, 1] += 1e-3**2
    found = matrix(covariance.twist(Window(50_000_000, deltas)))
    assert np.allclose(found, expected, rtol=1e-9, atol=1e-18)


def test_a_base_whose_rollers_slip_is_as_unsure_of_its_way_to_the_side_as_that_is_long(kit):
    motors, window = kit.motors((0, 1, 2, 3)), Window(STEP_NS, (-300, 300, 310, -290))
    rolls, slips = (
        Covariance(mecanum(separation_m=0.2, base_m=0.2, sideways=share), motors)
        for share in (1.0, 0.8)
    )
    scale = np.diag([1.0, 0.8, 1.0])
    expected = scale @ matrix(rolls.twist(window)) @ scale
    assert matrix(slips.twist(window)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("name", "wheels", "deltas"), BASES)
@pytest.mark.parametrize(("unsure_ms", "rough_ms"), [(30, 0), (0, 5), (20, 10), (100, 0)])
def test_a_twist_of_an_unknown_length_of_time_scales_as_a_whole(
    kit, name, wheels, deltas, unsure_ms, rough_ms
):
    kinematics = getattr(kit, name)()
    covariance = Covariance(kinematics, kit.motors(wheels), noise_m=1e-5)
    shortest_s = max(0.05 - unsure_ms / 1e3, 0.0025)
    way = np.array(kinematics.forward) @ np.array(deltas) * kit.tick_m
    part = (0.5 * (0.05 / shortest_s - 1.0)) ** 2 + (rough_ms / 50.0) ** 2
    expected = spread_of_wheels(kit, kinematics, deltas, 1e-5) / shortest_s**2
    expected += part * np.outer(way, way) / 0.05**2
    if name == "differential":
        expected[1, 1] += SIDEWAYS_M_S**2
    window = Window(50_000_000, deltas, unsure_ms * 1_000_000, rough_ms * 1_000_000)
    assert np.allclose(matrix(covariance.twist(window)), expected, rtol=1e-9, atol=1e-18)


@pytest.mark.parametrize(("name", "wheels", "deltas"), BASES)
@pytest.mark.parametrize("theta", [0.0, 0.7, -2.0])
def test_a_step_carries_a_small_covariance_through_its_jacobians(kit, name, wheels, deltas, theta):
    """A heading that is nearly known makes all linear: every entry, cross terms included."""
    kinematics, motors, noise_m = getattr(kit, name)(), kit.motors(wheels), 1e-6

    def end(way):
        integrator = Integrator(kinematics, motors, corrected=False)
        integrator.set_pose(Pose2d(theta=theta), (0,) * len(motors))
        integrator.integrate(way, way, STEP_NS)
        return np.array([integrator.pose.x, integrator.pose.y, integrator.pose.theta])

    base = Base(kinematics, motors, noise_m=noise_m)
    base.integrator.set_pose(Pose2d(theta=theta), (0,) * len(motors))
    base.covariance.set_pose(theta, (4e-6, 1e-6, 5e-7, 1e-6, 9e-6, -8e-7, 5e-7, -8e-7, 1e-6))
    before = base.pose
    arc = base.step(*deltas)
    columns = []
    for motor in range(len(deltas)):
        more, less = list(deltas), list(deltas)
        more[motor] += 1
        less[motor] -= 1
        columns.append((end(more) - end(less)) / (2 * kit.tick_m))
    wheels_noise = np.diag(noise_m * np.abs(np.array(deltas)) * kit.tick_m)
    process = np.column_stack(columns) @ wheels_noise @ np.column_stack(columns).T
    moved = np.array([[1.0, 0.0, -arc.dy], [0.0, 1.0, arc.dx], [0.0, 0.0, 1.0]])
    expected = moved @ before @ moved.T + process
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.max(np.abs(base.pose - expected) / scale) < 1e-3


@pytest.mark.parametrize("theta", [0.0, 0.6, 2.5])
def test_the_floor_of_a_set_pose_lies_along_its_heading(kit, theta):
    covariance = Covariance(kit.mecanum(), kit.motors((0, 1, 2, 3)))
    covariance.set_pose(0.0)
    straight = matrix(covariance.pose)
    covariance.set_pose(theta)
    turn = np.array(
        [[math.cos(theta), -math.sin(theta), 0], [math.sin(theta), math.cos(theta), 0], [0, 0, 1]]
    )
    assert np.allclose(matrix(covariance.pose), turn @ straight @ turn.T, atol=1e-16)


def test_a_covariance_that_is_symmetric_only_to_rounding_counts_by_its_halves(kit):
    covariance = Covariance(kit.differential(), kit.motors())
    floor = matrix(covariance.pose)
    covariance.set_pose(0.0, (1.0, 0.3, 0.1, 0.1, 1.0, 0.0, 0.3, 0.2, 1.0))
    found = matrix(covariance.pose) - floor
    assert found[0, 1] == pytest.approx(0.2)
    assert found[0, 2] == pytest.approx(0.2)
    assert found[1, 2] == pytest.approx(0.1)


def test_an_unknown_order_grows_the_place_by_what_it_may_be_off(base):
    before = base.pose
    assert base.covariance.bridge(Arc(0.3, 0.4, 1.0, 0.0, 0.6)) == pytest.approx(0.15)
    growth = base.pose - before
    assert growth[0, 0] == growth[1, 1] == pytest.approx((0.5 * 0.6) ** 2 / 12.0)
    assert growth[2, 2] == 0.0
    assert base.covariance.bridge(Arc(0.0, 1.0, 1.0, 0.0, -20.0)) == 2.0
    assert base.pose[0, 0] - before[0, 0] - growth[0, 0] == pytest.approx(1.0)


def test_travel_that_was_not_counted_may_have_turned_the_base(kit, base):
    before = base.pose
    base.covariance.lose(0.03)
    # Two wheels, each off by an even spread over 30 mm either way.
    turned = 2.0 * 0.03**2 / 3.0 / kit.track_m**2
    assert (base.pose - before)[2, 2] == pytest.approx(turned)


# Consistency


def chi_squared_bounds(degrees):
    """The middle 99 % of chi-squared over its degrees of freedom (Wilson and Hilferty)."""
    spread = 2.0 / (9.0 * degrees)
    return tuple((1.0 - spread + z * math.sqrt(spread)) ** 3 for z in (-2.576, 2.576))


def second_moments(kit, noise_m, counts, many, chance):
    """Errors of many bases whose wheels roll other ways than counted, about the counted pose."""
    at = np.zeros((3, many))
    estimated = np.zeros(3)
    for each in counts:
        mean = np.array(each) * kit.tick_m
        spread = np.sqrt(noise_m * np.abs(mean))
        rolled = mean[:, None] + spread[:, None] * chance.normal(size=(2, many))
        for pose, wheels in ((at, rolled), (estimated, mean)):
            turn = (wheels[1] - wheels[0]) / kit.track_m
            middle = pose[2] + turn / 2
            way = np.sinc(turn / 2 / np.pi) * (wheels[0] + wheels[1]) / 2
            pose[0] += way * np.cos(middle)
            pose[1] += way * np.sin(middle)
            pose[2] += turn
    errors = at - estimated[:, None]
    return errors @ errors.T / many


WAYS = {
    "straight": [(600, 600)] * 100,
    "circle": [(700, 800)] * 120,
    "curves": [(round(600 + 160 * math.sin(n / 4)), 600) for n in range(100)],
}


@pytest.mark.parametrize("noise_m", [1e-5, 1e-3])
@pytest.mark.parametrize("way", WAYS)
def test_the_covariance_is_the_second_moment_of_many_errors_however_far_the_heading_strays(
    kit, way, noise_m
):
    """With the larger noise, nothing is known of the heading in the end: 1 rad and more."""
    chance = np.random.default_rng(11)
    base = Base(kit.differential(), kit.motors(), noise_m=noise_m)
    base.covariance.set_pose(0.0)
    for deltas in WAYS[way]:
        base.step(*deltas)
    found = second_moments(kit, noise_m, WAYS[way], 8_000, chance)
    inner = base.pose
    scale = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert np.max(np.abs(inner - found) / scale) < 0.06


def test_a_heading_that_wanders_makes_a_straight_way_shorter(kit):
    """By s*s/4 of it at the mean, which is more than the wheels' own error after ten metres."""
    base = Base(kit.differential(), kit.motors(), noise_m=1e-5)
    while base.integrator.pose.x < 10.0:
        base.step(125, 125)
    shortening_m = 10.0 * base.pose[2, 2] / 4.0
    wheels_own_m2 = 10.0 * 1e-5 / 2.0
    assert base.pose[0, 0] > wheels_own_m2 + shortening_m**2


def test_a_way_back_makes_the_pose_no_surer(kit):
    base = Base(kit.differential(), kit.motors(), noise_m=1e-3)
    volumes = []
    for deltas in [(120, 120)] * 200 + [(-120, -120)] * 200:
        base.step(*deltas)
        check_sound(base.pose)
        volumes.append(np.linalg.det(base.pose))
    assert (np.diff(volumes) >= -1e-9 * np.array(volumes[1:])).all()


@pytest.mark.parametrize(
    "path",
    [
        "curves",
        pytest.param("straight", marks=pytest.mark.nightly),
        pytest.param("spin", marks=pytest.mark.nightly),
    ],
)
def test_the_average_nees_of_many_runs_lies_in_its_chi_squared_bounds(kit, path):
    """Wheels roll farther or less far than counted, by the model; counts are whole."""
    runs, steps, noise_m = 150, 120, 1e-5
    chance = np.random.default_rng(7)
    nees = []
    for _ in range(runs):
        base = Base(kit.differential(), kit.motors(), noise_m=noise_m)
        truth = np.zeros(3)
        exact = chance.uniform(0.0, 1.0, 2)
        first = last = np.floor(exact)
        for n in range(steps):
            mean = {
                "straight": (120.0, 120.0),
                "curves": (120.0 + 60.0 * math.sin(n / 9), 120.0 - 60.0 * math.sin(n / 9)),
                "spin": (-60.0, 61.0),
            }[path]
            turned = np.array(mean) + chance.normal(0.0, 2.0, 2)
            exact = exact + turned
            now = np.floor(exact)
            base.step(*(now - last).astype(int).tolist())
            last = now
            rolled = turned * kit.tick_m
            rolled = rolled + chance.normal(0.0, 1.0, 2) * np.sqrt(noise_m * np.abs(rolled))
            ds, turn = rolled.mean(), (rolled[1] - rolled[0]) / kit.track_m
            middle = truth[2] + turn / 2
            scale = np.sinc(turn / 2 / np.pi) * ds
            truth += (scale * math.cos(middle), scale * math.sin(middle), turn)
        pose = base.integrator.pose
        error = np.array([pose.x, pose.y, pose.theta]) - truth
        nees.append(float(error @ np.linalg.solve(base.pose, error)))
        assert (first >= 0).all()
    low, high = chi_squared_bounds(3 * runs)
    assert low < np.mean(nees) / 3.0 < high


def test_the_floor_keeps_its_cross_terms_where_wheels_are_not_alike(kit):
    motors = kit.motors((0, 1, 2, 3))
    motors = (msgspec.structs.replace(motors[0], radius_m=0.05), *motors[1:])
    covariance = Covariance(kit.mecanum(), motors)
    straight, theta = matrix(covariance.pose), 0.6
    assert abs(straight[1, 2]) > 1e-9
    assert abs(straight[0, 1]) > 1e-12
    covariance.set_pose(theta)
    cos, sin = math.cos(theta), math.sin(theta)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    # A variance below that of one straight on is raised to it.
    found, expected = matrix(covariance.pose), turn @ straight @ turn.T
    assert found[0] == pytest.approx(expected[0], rel=1e-9)
    assert found[1, 2] == pytest.approx(expected[1, 2], rel=1e-9)


# With a gyro


def test_with_a_gyro_the_heading_is_as_sure_as_it_is_said_to_be(base):
    base.covariance.set_pose(0.0, (0.0,) * 8 + (1e-4,))
    given = base.pose[2, 2]
    for fused in (1e-5, 2e-5, 5e-6):
        base.covariance.propagate((40, 60), ARC, fused)
        assert base.pose[2, 2] == pytest.approx(given + fused)
        check_sound(base.pose)


def test_with_a_gyro_an_error_of_heading_becomes_one_of_place(base):
    """All that the heading was off came at the start, and the way after it is straight."""
    base.covariance.propagate((1, 1), ARC, 4e-6)
    before = base.pose
    for _ in range(100):
        base.covariance.propagate(
            (200, 200), base.integrator.integrate((200, 200), (0, 0), 1), 4e-6
        )
    way = base.integrator.pose.x
    sideways = base.pose[1, 1] - before[1, 1]
    assert sideways == pytest.approx(before[2, 2] * way * way, rel=0.02)
    assert base.pose[1, 2] == pytest.approx(before[2, 2] * way, rel=0.02)


def test_a_heading_that_becomes_surer_stays_as_correlated_as_it_was():
    found = matrix(with_heading((4.0, 0.5, 0.6, 0.5, 9.0, 1.2, 0.6, 1.2, 0.16), 0.04))
    assert np.allclose(found, [[4.0, 0.5, 0.3], [0.5, 9.0, 0.6], [0.3, 0.6, 0.04]])


def test_without_a_window_nothing_is_known_of_the_twist(kit):
    twist = Covariance(kit.differential(), kit.motors()).twist(Window(0, (0, 0), 0, 0))
    assert np.array_equal(matrix(twist), np.eye(3))


def test_where_the_base_is_heading_makes_no_difference_to_how_well_its_pose_is_known(kit):
    motors = kit.motors((0, 1, 2, 3))
    # Wheels of different sizes make the forward and the sideways measurement depend on each other.
    uneven = tuple(
        msgspec.structs.replace(motor, radius_m=motor.radius_m * (1.0 + 0.2 * n))
        for n, motor in enumerate(motors)
    )
    covariance = Covariance(kit.mecanum(), uneven)
    ahead = matrix(covariance.pose)
    assert abs(ahead[0, 1]) > 1e-3 * ahead[0, 0]
    for theta in (0.4, 2.0, -2.6):
        turn = np.array(
            [
                [math.cos(theta), -math.sin(theta), 0.0],
                [math.sin(theta), math.cos(theta), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        covariance.set_pose(theta)
        wanted = turn @ ahead @ turn.T
        # No way is known better than to a tick.
        for axis in (0, 1):
            wanted[axis, axis] = max(wanted[axis, axis], ahead[0, 0])
        assert matrix(covariance.pose) == pytest.approx(wanted, abs=1e-15)


def test_a_robot_that_stands_knows_its_heading_less_and_less_by_a_gyro(base):
    still = base.integrator.integrate((0, 0), (0, 0), STEP_NS)
    for _ in range(10):
        base.covariance.propagate((0, 0), still, 0.1)
    assert base.pose[2, 2] == pytest.approx(base.covariance.given + 0.1)


def test_a_pose_that_is_set_unsurely_spreads_as_its_headings_do(kit):
    chance = np.random.default_rng(1)
    given = np.array([[0.04, 0.01, 0.05], [0.01, 0.09, -0.06], [0.05, -0.06, 0.5]])
    covariance = Covariance(kit.differential(), kit.motors(), noise_m=1e-12)
    covariance.set_pose(0.0, tuple(given.ravel()))
    for _ in range(100):
        covariance.propagate((60, 60), Arc(0.02, 0.0, 1.0, 0.0, 0.0))
    poses = chance.multivariate_normal([0.0, 0.0, 0.0], given, 400_000)
    x = poses[:, 0] + 2.0 * np.cos(poses[:, 2]) - 2.0
    y = poses[:, 1] + 2.0 * np.sin(poses[:, 2])
    found = matrix(covariance.pose)
    wanted = np.array([[np.mean(x * x), np.mean(x * y)], [np.mean(x * y), np.mean(y * y)]])
    assert found[:2, :2] == pytest.approx(wanted, rel=0.02, abs=0.01)


def test_the_noise_of_a_step_is_turned_into_the_frame_with_all_its_correlations(kit):
    """Written out with numpy: the Jacobian over (forward, left, turn) of the arc's end."""
    kinematics, motors = kit.mecanum(), kit.motors((0, 1, 2, 3))
    covariance = Covariance(kinematics, motors, noise_m=0.01)
    deltas, arc = (400, -100, 50, 220), Arc(0.03, -0.02, 0.8, 0.6, 0.3)
    before = matrix(covariance.pose)
    covariance.propagate(deltas, arc)
    forward = np.array(kinematics.forward)
    noise = sum(
        0.01 * abs(delta) * kit.tick_m * np.outer(forward[:, wheel], forward[:, wheel])
        for wheel, delta in enumerate(deltas)
    )
    dx, dy, cos, sin, turn = arc
    arm = -0.5 * dy - turn * dx / 12.0, 0.5 * dx - turn * dy / 12.0
    jacobian = np.array([[cos, -sin, arm[0]], [sin, cos, arm[1]], [0.0, 0.0, 1.0]])
    gained = matrix(covariance.pose) - before
    expected = jacobian @ noise @ jacobian.T
    assert gained == pytest.approx(expected, rel=1e-3, abs=1e-3 * float(np.max(expected)))
    assert covariance.gained == pytest.approx(expected[2, 2])
