"""The encoders of ROS 2's messages, byte for byte against rosbags."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.ros2.messages import ros2_encoders

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"

# ROS 2 strings end at the first zero byte, so none holds one.
texts = st.text("aZ_/ é漢\U0001f600", max_size=40)
doubles = st.floats(allow_nan=True, allow_infinity=True)
singles = st.floats(width=32, allow_nan=True)
stamps_ns = st.integers(0, 2**31 * 10**9 - 1)


def numbers(count):
    return st.lists(doubles, min_size=count, max_size=count)


@given(six=numbers(6), frame=texts, stamp_ns=stamps_ns, big_endian=st.booleans())
def test_twists_for_clients_equal_rosbags(oracle, ros, six, frame, stamp_ns, big_endian):
    value = ros.twist(six)
    assert ros2_encoders.twist(six, big_endian=big_endian) == oracle.encode(
        TWIST, value, little_endian=not big_endian
    )
    assert ros2_encoders.twist_stamped(stamp_ns, frame, six) == oracle.encode(
        TWIST_STAMPED, {"header": ros.header(stamp_ns, frame), "twist": value}
    )


@given(stamps_ns, texts, texts, numbers(7), numbers(36), numbers(6), numbers(36))
def test_odometry_equals_rosbags(oracle, ros, stamp_ns, frame, child, pose, pcov, twist, tcov):
    value = {
        "header": ros.header(stamp_ns, frame),
        "child_frame_id": child,
        "pose": {
            "pose": {"position": ros.xyz(pose[:3]), "orientation": ros.quaternion(pose[3:])},
            "covariance": pcov,
        },
        "twist": {"twist": ros.twist(twist), "covariance": tcov},
    }
    encode = ros2_encoders.odometry(frame, child)
    assert encode(stamp_ns, pose, pcov, twist, tcov) == oracle.encode(
        "nav_msgs/msg/Odometry", value
    )


def test_odometry_between_odom_and_base_link_has_its_known_size():
    payload = ros2_encoders.odometry("odom", "base_link")(1, [0] * 7, [0] * 36, [0] * 6, [0] * 36)
    assert len(payload) == 724


@given(stamps_ns, st.lists(st.tuples(texts, texts, numbers(7)), max_size=4))
def test_transforms_equal_rosbags(oracle, ros, stamp_ns, transforms):
    value = {
        "transforms": [
            {
                "header": ros.header(stamp_ns, parent),
                "child_frame_id": child,
                "transform": {"translation": ros.xyz(t[:3]), "rotation": ros.quaternion(t[3:])},
            }
            for parent, child, t in transforms
        ]
    }
    encode = ros2_encoders.transforms([(parent, child) for parent, child, _ in transforms])
    assert encode(stamp_ns, [t for *_, t in transforms]) == oracle.encode(
        "tf2_msgs/msg/TFMessage", value
    )


@given(stamps_ns, texts, st.lists(st.tuples(texts, doubles, doubles), max_size=5))
def test_joint_states_equal_rosbags(oracle, ros, stamp_ns, frame, joints):
    names, position, velocity = ([joint[i] for joint in joints] for i in range(3))
    value = {
        "header": ros.header(stamp_ns, frame),
        "name": names,
        "position": position,
        "velocity": velocity,
        "effort": [],
    }
    encode = ros2_encoders.joint_state(frame, names)
    assert encode(stamp_ns, position, velocity) == oracle.encode(
        "sensor_msgs/msg/JointState", value
    )


@given(stamps_ns, texts, singles, singles)
def test_battery_states_equal_rosbags(oracle, ros, stamp_ns, frame, volts, charge):
    unknown = ["temperature", "current", "charge", "capacity", "design_capacity"]
    value = {
        "header": ros.header(stamp_ns, frame),
        "voltage": volts,
        **dict.fromkeys(unknown, math.nan),
        "percentage": charge,
        "power_supply_status": 0,
        "power_supply_health": 0,
        "power_supply_technology": 0,
        "present": True,
        "cell_voltage": [],
        "cell_temperature": [],
        "location": "",
        "serial_number": "",
    }
    payload = ros2_encoders.battery_state(frame)(stamp_ns, volts, charge)
    assert payload == oracle.encode("sensor_msgs/msg/BatteryState", value)


def test_a_voltage_too_large_for_the_message_becomes_infinite():
    encode = ros2_encoders.battery_state("base_link")
    assert encode(1, -1e300, 0.5) == encode(1, -math.inf, 0.5)
    largest = (2.0 - 2.0**-23) * 2.0**127
    assert encode(1, largest, 0.5) != encode(1, math.inf, 0.5)


@given(
    stamps_ns,
    texts,
    st.lists(
        st.builds(
            ros2_encoders.Diagnostic,
            st.integers(0, 3),
            texts,
            texts,
            texts,
            st.lists(st.tuples(texts, texts), max_size=3),
        ),
        max_size=3,
    ),
)
def test_diagnostics_equal_rosbags(oracle, ros, stamp_ns, frame, status):
    value = {
        "header": ros.header(stamp_ns, frame),
        "status": [
            {
                **one._asdict(),
                "values": [{"key": key, "value": text} for key, text in one.values],
            }
            for one in status
        ],
    }
    assert ros2_encoders.diagnostics(stamp_ns, frame, status) == oracle.encode(
        "diagnostic_msgs/msg/DiagnosticArray", value
    )


def test_seconds_wrap_after_2038_rather_than_fail():
    assert ros2_encoders.stamp(2**31 * 10**9 + 5) == (2**31, 5)
    assert ros2_encoders.stamp(2**32 * 10**9 + 5) == (0, 5)


@pytest.mark.parametrize("flag", [True, False])
@pytest.mark.parametrize("ros_type", ["std_msgs/msg/Bool", "std_srvs/srv/SetBool_Request"])
def test_flags_equal_rosbags(oracle, flag, ros_type):
    assert ros2_encoders.boolean(flag) == oracle.encode(ros_type, {"data": flag})


def test_a_trigger_request_equals_rosbags(oracle):
    value = {"structure_needs_at_least_one_member": 0}
    assert ros2_encoders.trigger_request() == oracle.encode("std_srvs/srv/Trigger_Request", value)


@given(stamps_ns, texts, numbers(4), numbers(9), numbers(3), numbers(9), numbers(3), numbers(9))
def test_imu_samples_equal_rosbags(
    oracle, ros, stamp_ns, frame, quaternion, qcov, turn, tcov, force, fcov
):
    value = {
        "header": ros.header(stamp_ns, frame),
        "orientation": dict(zip("xyzw", quaternion, strict=True)),
        "orientation_covariance": list(qcov),
        "angular_velocity": dict(zip("xyz", turn, strict=True)),
        "angular_velocity_covariance": list(tcov),
        "linear_acceleration": dict(zip("xyz", force, strict=True)),
        "linear_acceleration_covariance": list(fcov),
    }
    ours = ros2_encoders.imu(frame)(stamp_ns, (*quaternion, *qcov), (*turn, *tcov), (*force, *fcov))
    assert ours == oracle.encode("sensor_msgs/msg/Imu", value)
