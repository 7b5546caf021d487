"""The plane inside ROS 2's six dimensions."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.model import OdometryEstimate, Pose2d, Twist2d
from yahboomd.ros2.messages import planar

COVARIANCE = (1.0, 2.0, 3.0, 2.0, 4.0, 5.0, 3.0, 5.0, 6.0)


STAMP_NS = 1_700_000_000_000_000_005
ESTIMATE = OdometryEstimate(
    stamp_ns=0,
    pose=Pose2d(x=1.5, y=-2.5, theta=0.5),
    twist=Twist2d(vx=0.25, vy=-0.125, wz=2.0),
    pose_covariance=COVARIANCE,
    twist_covariance=COVARIANCE,
    motor_ticks=(),
    motor_position_rad=(),
    motor_speed_m_s=(),
)


@given(st.floats(-1e4, 1e4))
def test_the_quaternion_turns_by_the_heading(theta):
    x, y, z, w = planar.quaternion(theta)
    assert (x, y) == (0.0, 0.0)
    assert math.hypot(z, w) == pytest.approx(1.0)
    yaw = math.atan2(2 * w * z, 1 - 2 * z * z)
    assert math.cos(yaw - theta) == pytest.approx(1.0)


@given(st.floats(-3.0, 3.0), st.floats(-1.5, 1.5), st.floats(-3.0, 3.0))
def test_a_rotation_turns_about_x_then_y_then_z(roll, pitch, yaw):
    def about(axis, angle):
        out = [0.0, 0.0, 0.0, math.cos(angle / 2)]
        out[axis] = math.sin(angle / 2)
        return out

    def product(a, b):
        ax, ay, az, aw = a
        bx, by, bz, bw = b
        return (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )

    wanted = product(product(about(2, yaw), about(1, pitch)), about(0, roll))
    assert planar.rotation(roll, pitch, yaw) == pytest.approx(wanted, abs=1e-12)


def test_covariances_keep_their_place_and_the_rest_is_unmeasured():
    full = planar.covariance(COVARIANCE)
    rows = [full[6 * i : 6 * i + 6] for i in range(6)]
    axes = (0, 1, 5)
    assert [rows[i][j] for i in axes for j in axes] == list(COVARIANCE)
    others = {(i, j): rows[i][j] for i in range(6) for j in range(6) if not {i, j} <= set(axes)}
    assert all(v == (planar.UNMEASURED if i == j else 0.0) for (i, j), v in others.items())


def test_odometry_says_what_the_estimate_says(oracle):
    payload = planar.odometry("odom", "base")(STAMP_NS, ESTIMATE)
    message = oracle.decode("nav_msgs/msg/Odometry", payload)
    assert message["header"] == {
        "stamp": {"sec": 1_700_000_000, "nanosec": 5},
        "frame_id": "odom",
    }
    assert message["child_frame_id"] == "base"
    assert message["pose"]["pose"] == {
        "position": {"x": 1.5, "y": -2.5, "z": 0.0},
        "orientation": {"x": 0.0, "y": 0.0, "z": math.sin(0.25), "w": math.cos(0.25)},
    }
    assert message["twist"]["twist"] == {
        "linear": {"x": 0.25, "y": -0.125, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": 2.0},
    }
    assert message["pose"]["covariance"] == list(planar.covariance(COVARIANCE))
    assert message["twist"]["covariance"] == list(planar.covariance(COVARIANCE))


def test_the_transform_says_the_same_as_the_pose(oracle):
    payload = planar.transform("odom", "base_link")(STAMP_NS, Pose2d(x=1.5, y=-2.5, theta=math.pi))
    (transform,) = oracle.decode("tf2_msgs/msg/TFMessage", payload)["transforms"]
    assert transform["header"]["frame_id"] == "odom"
    assert transform["child_frame_id"] == "base_link"
    assert transform["transform"]["translation"] == {"x": 1.5, "y": -2.5, "z": 0.0}
    assert transform["transform"]["rotation"]["z"] == pytest.approx(1.0)
