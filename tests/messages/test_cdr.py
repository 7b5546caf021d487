"""The CDR codecs, byte for byte against rosbags."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.messages import cdr

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"

# ROS 2 strings end at the first zero byte, so none holds one.
texts = st.text("aZ_/ é漢\U0001f600", max_size=40)
doubles = st.floats(allow_nan=True, allow_infinity=True)
finite = st.floats(min_value=-1e6, max_value=1e6)
singles = st.floats(width=32, allow_nan=True)
stamps_ns = st.integers(0, 2**31 * 10**9 - 1)
real_stamps_ns = st.integers(1, 2**31 * 10**9 - 1)
little = st.booleans()


def numbers(count, of=doubles):
    return st.lists(of, min_size=count, max_size=count)


# --- in -------------------------------------------------------------------------------------


@given(six=numbers(6, finite), little_endian=little)
def test_a_twist_is_read_in_both_byte_orders(oracle, ros, six, little_endian):
    payload = oracle.encode(TWIST, ros.twist(six), little_endian=little_endian)
    assert cdr.decode_velocity(payload) == (six[0], six[1], six[5], None, True)


@given(six=numbers(6, finite), frame=texts, stamp_ns=real_stamps_ns, little_endian=little)
def test_a_stamped_twist_is_read_with_any_frame_id(
    oracle, ros, six, frame, stamp_ns, little_endian
):
    value = {"header": ros.header(stamp_ns, frame), "twist": ros.twist(six)}
    payload = oracle.encode(TWIST_STAMPED, value, little_endian=little_endian)
    assert cdr.decode_velocity(payload) == (six[0], six[1], six[5], stamp_ns, True)


def test_a_zero_stamp_counts_as_none(oracle, ros):
    value = {"header": ros.header(0, "base_link"), "twist": ros.twist([1, 2, 0, 0, 0, 3])}
    velocity = cdr.decode_velocity(oracle.encode(TWIST_STAMPED, value))
    assert velocity == (1.0, 2.0, 3.0, None, True)


def test_option_bytes_of_the_header_do_not_matter(oracle, ros):
    payload = oracle.encode(TWIST, ros.twist([1, 2, 3, 4, 5, 6]))
    assert cdr.decode_velocity(payload[:2] + b"\x12\x03" + payload[4:]) == (1, 2, 6, None, True)


@pytest.mark.parametrize("frame", ["", "b", "base_link", "a" * 60])
def test_every_truncation_and_extension_of_a_twist_is_refused(oracle, ros, frame):
    twist = ros.twist([1, 2, 3, 4, 5, 6])
    value = {"header": ros.header(123, frame), "twist": twist}
    stamped = oracle.encode(TWIST_STAMPED, value)
    for whole in (oracle.encode(TWIST, twist), stamped):
        # 52 bytes may be a truncated message or a Twist: a Twist is assumed.
        for size in set(range(len(whole))) - {cdr.TWIST_BYTES}:
            assert isinstance(cdr.decode_velocity(whole[:size]), str), size
        for extra in range(1, 17):
            assert isinstance(cdr.decode_velocity(whole + bytes(extra)), str), extra


@pytest.mark.parametrize("place", range(6))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_seen_in_every_place(place, value):
    six = [1.0] * 6
    six[place] = value
    velocity = cdr.decode_velocity(cdr.HEADER_LE + struct.pack("<6d", *six))
    assert isinstance(velocity, cdr.Velocity)
    assert not velocity.finite


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"), [(-1, 0), (-(2**31), 5), (0, 1_000_000_000), (7, 2**32 - 1)]
)
def test_a_stamp_that_is_no_time_is_refused(seconds, nanoseconds):
    body = struct.pack("<iII4s6d", seconds, nanoseconds, 1, b"", *[0.5] * 6)
    assert cdr.decode_velocity(cdr.HEADER_LE + body) == "a stamp that is no time"


def test_a_frame_id_without_its_end_is_refused():
    body = struct.pack("<iII4s6d", 1, 0, 4, b"base", *[0.5] * 6)
    assert isinstance(cdr.decode_velocity(cdr.HEADER_LE + body), str)


@given(st.binary(max_size=200))
def test_no_bytes_make_the_decoders_raise(data):
    for payload in (data, b"\x00\x01" + data, b"\x00\x00" + data):
        assert isinstance(cdr.decode_velocity(payload), cdr.Velocity | str)
        assert isinstance(cdr.decode_bool(payload), bool | str)


@given(st.binary(min_size=66, max_size=200), little)
def test_what_is_read_as_a_velocity_is_one_to_rosbags_too(oracle, data, little_endian):
    payload = bytes((0, little_endian)) + data
    velocity = cdr.decode_velocity(payload)
    if isinstance(velocity, cdr.Velocity):
        length = int.from_bytes(payload[12:16], "little" if little_endian else "big")
        # rosbags decodes the frame's name, which may be no UTF-8: the twist does not depend on it.
        named = payload[:16] + b"x" * (length - 1) + payload[15 + length :]
        assert oracle.decode(TWIST_STAMPED, named)


@given(six=numbers(6), frame=texts, stamp_ns=stamps_ns, big_endian=st.booleans())
def test_twists_for_clients_equal_rosbags(oracle, ros, six, frame, stamp_ns, big_endian):
    value = ros.twist(six)
    assert cdr.twist(six, big_endian=big_endian) == oracle.encode(
        TWIST, value, little_endian=not big_endian
    )
    assert cdr.twist_stamped(stamp_ns, frame, six) == oracle.encode(
        TWIST_STAMPED, {"header": ros.header(stamp_ns, frame), "twist": value}
    )


# --- out ------------------------------------------------------------------------------------


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
    encode = cdr.odometry(frame, child)
    assert encode(stamp_ns, pose, pcov, twist, tcov) == oracle.encode(
        "nav_msgs/msg/Odometry", value
    )


def test_odometry_between_odom_and_base_link_has_its_known_size():
    payload = cdr.odometry("odom", "base_link")(1, [0] * 7, [0] * 36, [0] * 6, [0] * 36)
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
    encode = cdr.transforms([(parent, child) for parent, child, _ in transforms])
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
    encode = cdr.joint_state(frame, names)
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
    payload = cdr.battery_state(frame)(stamp_ns, volts, charge)
    assert payload == oracle.encode("sensor_msgs/msg/BatteryState", value)


def test_a_voltage_too_large_for_the_message_becomes_infinite():
    encode = cdr.battery_state("base_link")
    assert encode(1, -1e300, 0.5) == encode(1, -math.inf, 0.5)
    largest = (2.0 - 2.0**-23) * 2.0**127
    assert encode(1, largest, 0.5) != encode(1, math.inf, 0.5)


@given(
    stamps_ns,
    texts,
    st.lists(
        st.builds(
            cdr.Diagnostic,
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
    assert cdr.diagnostics(stamp_ns, frame, status) == oracle.encode(
        "diagnostic_msgs/msg/DiagnosticArray", value
    )


def test_seconds_wrap_after_2038_rather_than_fail():
    assert cdr.stamp(2**31 * 10**9 + 5) == (2**31, 5)
    assert cdr.stamp(2**32 * 10**9 + 5) == (0, 5)


# --- services -------------------------------------------------------------------------------


@given(st.booleans(), texts)
def test_service_responses_equal_rosbags(oracle, success, message):
    value = {"success": success, "message": message}
    payload = cdr.service_response(success, message)
    assert payload == oracle.encode("std_srvs/srv/Trigger_Response", value)
    assert payload == oracle.encode("std_srvs/srv/SetBool_Response", value)


@pytest.mark.parametrize("flag", [True, False])
@pytest.mark.parametrize("ros_type", ["std_msgs/msg/Bool", "std_srvs/srv/SetBool_Request"])
def test_flags_equal_rosbags_and_are_read_back(oracle, flag, ros_type):
    payload = oracle.encode(ros_type, {"data": flag})
    assert cdr.boolean(flag) == payload
    assert cdr.decode_bool(payload) is flag
    assert cdr.decode_bool(b"\x00\x00" + payload[2:] + bytes(3)) is flag


def test_a_trigger_request_equals_rosbags(oracle):
    value = {"structure_needs_at_least_one_member": 0}
    assert cdr.trigger_request() == oracle.encode("std_srvs/srv/Trigger_Request", value)


@pytest.mark.parametrize(
    "payload",
    [b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00\x02", cdr.HEADER_LE + bytes(5), b"{}abc"],
)
def test_what_is_no_set_bool_is_refused(payload):
    assert isinstance(cdr.decode_bool(payload), str)


def test_only_plain_cdr_counts_as_cdr():
    assert cdr.is_cdr(b"\x00\x00\x00\x00")
    assert cdr.is_cdr(b"\x00\x01\x00\x03body")
    assert not cdr.is_cdr(b"\x00\x01\x00")
    assert not cdr.is_cdr(b"\x00\x03\x00\x00body")


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
    ours = cdr.imu(frame)(stamp_ns, (*quaternion, *qcov), (*turn, *tcov), (*force, *fcov))
    assert ours == oracle.encode("sensor_msgs/msg/Imu", value)
