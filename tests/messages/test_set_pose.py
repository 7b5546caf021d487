import json
import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from make.schema_files.cdr_samples import pose_message
from yahboomd.core.drive.kinematics import differential
from yahboomd.core.messages.codecs import Refusal, decode_set_pose
from yahboomd.core.messages.native import MAX_PLACE_M, MAX_THETA_RAD, MAX_VARIANCE, SetPoseRequest
from yahboomd.core.messages.set_pose import covariance_problem, decode_pose
from yahboomd.core.model import Motor
from yahboomd.core.odometry.covariance import Covariance
from yahboomd.core.odometry.integrator import Arc

UNIT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def decoded(covariance, **pose):
    request = {"x": 0.0, "y": 0.0, "theta": 0.0, "covariance": covariance} | pose
    return decode_set_pose(json.dumps(request).encode())


def changed(*entries):
    matrix = list(UNIT)
    for index, value in entries:
        matrix[index] = value
    return tuple(matrix)


@st.composite
def covariances(draw):
    """A matrix times its transpose: positive semidefinite but for rounding."""
    entry = st.floats(-1e5, 1e5) | st.floats(-1e-3, 1e-3) | st.just(0.0)
    root = [[draw(entry) for _ in range(3)] for _ in range(3)]
    return tuple(
        sum(root[row][k] * root[column][k] for k in range(3))
        for row in range(3)
        for column in range(3)
    )


@pytest.mark.parametrize("index", range(9))
def test_a_covariance_of_1e308_is_refused_with_words(index):
    result = decoded(changed((index, 1e308)))
    assert isinstance(result, Refusal)
    assert "covariance" in result.detail


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (changed((0, -1e-9)), "0"),
        (changed((1, 0.5)), "not symmetric"),
        (changed((5, 0.5)), "not symmetric"),
        (changed((7, 0.5)), "not symmetric"),
        (changed((1, 1.1), (3, 1.1)), "beyond 1"),
        (changed((0, 0.0), (1, 0.1), (3, 0.1)), "zero"),
        (changed((1, 0.9), (3, 0.9), (2, 0.9), (6, 0.9), (5, -0.9), (7, -0.9)), "semidefinite"),
    ],
)
def test_what_is_no_covariance_is_refused_with_words(matrix, words):
    result = decoded(matrix)
    assert isinstance(result, Refusal)
    assert words in result.detail


@pytest.mark.parametrize(
    "matrix",
    [
        UNIT,
        (0.0,) * 9,
        changed((1, 1.0), (3, 1.0)),
        changed((1, 1e-6), (3, 0.0)),
        changed((0, MAX_VARIANCE), (8, 1e-12)),
        # Seven digits of a correlation of one.
        changed((0, 0.3333333), (1, 0.5773503), (3, 0.5773503)),
        # Two axes that are nearly certain, each fully correlated with the third.
        (1.0, 1e-6, 1e-6, 1e-6, 1e-12, 1e-12, 1e-6, 1e-12, 1e-12),
    ],
)
def test_what_can_be_a_covariance_is_taken(matrix):
    assert covariance_problem(matrix) is None
    assert isinstance(decoded(matrix), SetPoseRequest)


@given(covariances())
def test_a_matrix_times_its_transpose_is_a_covariance_in_seven_digits_too(matrix):
    assert covariance_problem(matrix) is None
    written = tuple(float(f"{value:.7g}") for value in matrix)
    lost = any(
        diagonal == 0.0 for diagonal, value in zip(written[::4], matrix[::4], strict=True) if value
    )
    assert lost or covariance_problem(written) is None


@given(covariances(), st.integers(0, 2), st.floats(1e-3, 1e3))
def test_a_variance_below_what_the_correlations_need_is_refused(matrix, axis, share):
    """Take more from a variance than an eigenvalue allows, and some direction has none left."""
    trace = matrix[0] + matrix[4] + matrix[8]
    assume(trace > 1e-6)
    lowered = list(matrix)
    lowered[4 * axis] = -share * trace
    assert covariance_problem(tuple(lowered)) is not None


@pytest.mark.parametrize(
    "pose",
    [
        {"x": 1e308},
        {"y": -2 * MAX_PLACE_M},
        {"theta": 2 * MAX_THETA_RAD},
    ],
)
def test_a_pose_out_of_all_proportion_is_refused(pose):
    assert isinstance(decoded(None, **pose), Refusal)


@given(
    st.tuples(*(st.floats(-2 * MAX_VARIANCE, 2 * MAX_VARIANCE),) * 9) | covariances(),
    st.floats(-MAX_THETA_RAD, MAX_THETA_RAD),
    st.lists(st.integers(-1000, 1000), max_size=20),
)
def test_odometry_goes_on_from_whatever_is_taken_in_finite_numbers(matrix, theta, steps):
    result = decoded(matrix, theta=theta)
    if isinstance(result, Refusal):
        return
    kinematics = differential(separation_m=0.2)
    motors = tuple(
        Motor(
            name=name,
            wheel=wheel,
            position=wheel + 1,
            command_sign=1,
            encoder_sign=1,
            radius_m=0.03,
            ticks_per_revolution=1000,
        )
        for wheel, name in enumerate(("left", "right"))
    )
    covariance = Covariance(kinematics, motors)
    covariance.set_pose(result.theta, result.covariance)
    for step in steps:
        turn = 1e-4 * step
        arc = Arc(
            0.1 * math.cos(theta), 0.1 * math.sin(theta), math.cos(theta), math.sin(theta), turn
        )
        covariance.propagate([step, -step], arc)
        covariance.lose(1.0)
    pose = covariance.pose
    assert all(map(math.isfinite, pose))
    assert min(pose[::4]) > 0.0


POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def message(ros, *, frame="odom", xyz=(1.0, -2.0, 0.5), quaternion=(0.0, 0.0, 0.6, 0.8), **entries):
    covariance = [0.0] * 36
    for entry, value in entries.items():
        covariance[int(entry.removeprefix("c"))] = value
    pose = {"position": ros.xyz(xyz), "orientation": ros.quaternion(quaternion)}
    return {"header": ros.header(5, frame), "pose": {"pose": pose, "covariance": covariance}}


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("frame", ["odom", "bot1/odom", "a" * 61])
def test_the_planar_part_of_a_ros_pose_is_read(oracle, ros, frame, little_endian):
    diagonal = {"c0": 0.25, "c1": 0.01, "c6": 0.01, "c7": 0.5, "c14": 9.0, "c35": 0.125}
    value = message(ros, frame=frame, **diagonal)
    wanted = decode_pose(oracle.encode(POSE, value, little_endian=little_endian), frame)
    assert isinstance(wanted, SetPoseRequest)
    assert (wanted.x, wanted.y) == (1.0, -2.0)
    assert wanted.theta == pytest.approx(2.0 * math.atan2(0.6, 0.8))
    assert wanted.covariance == (0.25, 0.01, 0.0, 0.01, 0.5, 0.0, 0.0, 0.0, 0.125)


def test_a_pose_is_written_as_ros_writes_it(oracle, ros):
    numbers = (1.0, -2.0, 0.5, 0.0, 0.0, 0.6, 0.8, *(number / 8 for number in range(36)))
    value = message(ros, **{f"c{index}": index / 8 for index in range(36)})
    assert pose_message(5, "odom", numbers) == oracle.encode(POSE, value)


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"frame": "map"}, 'its frame is "map", and a pose in "odom" is expected'),
        ({"frame": ""}, 'its frame is ""'),
        ({"frame": "/odom"}, 'its frame is "/odom"'),
        ({"xyz": (math.nan, 0.0, 0.0)}, "not finite"),
        ({"xyz": (1e300, 0.0, 0.0)}, "x"),
        ({"c35": math.inf}, "not finite"),
        ({"c0": -1.0}, "covariance"),
        ({"c1": 0.5}, "covariance"),
        ({"quaternion": (0.0, 0.0, 0.0, 0.0)}, "quaternion"),
        ({"quaternion": (0.0, 0.0, 3.0, 4.0)}, "quaternion"),
    ],
)
def test_a_ros_pose_that_cannot_be_set_has_its_reason(oracle, ros, fields, why):
    problem = decode_pose(oracle.encode(POSE, message(ros, **fields)), "odom")
    assert isinstance(problem, str)
    assert why in problem


@given(cut=st.integers(0, 400), noise=st.binary(max_size=20))
def test_what_is_no_ros_pose_is_named_so(oracle, ros, cut, noise):
    payload = oracle.encode(POSE, message(ros))
    for broken in (payload[:cut], payload[: min(cut, 30)] + noise, payload + noise):
        assume(broken != payload)
        assert "PoseWithCovarianceStamped" in str(decode_pose(broken, "odom"))
