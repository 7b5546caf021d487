"""CDR as the core reads and answers it, against rosbags."""

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
finite = st.floats(min_value=-1e6, max_value=1e6)
real_stamps_ns = st.integers(1, 2**31 * 10**9 - 1)
little = st.booleans()


def numbers(count, of):
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


# --- services -------------------------------------------------------------------------------


@given(st.booleans(), texts)
def test_service_responses_equal_rosbags(oracle, success, message):
    value = {"success": success, "message": message}
    payload = cdr.service_response(success, message)
    assert payload == oracle.encode("std_srvs/srv/Trigger_Response", value)
    assert payload == oracle.encode("std_srvs/srv/SetBool_Response", value)


@pytest.mark.parametrize("flag", [True, False])
@pytest.mark.parametrize("ros_type", ["std_msgs/msg/Bool", "std_srvs/srv/SetBool_Request"])
def test_flags_are_read_in_either_byte_order_and_padded(oracle, flag, ros_type):
    payload = oracle.encode(ros_type, {"data": flag})
    assert cdr.decode_bool(payload) is flag
    assert cdr.decode_bool(b"\x00\x00" + payload[2:] + bytes(3)) is flag


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
