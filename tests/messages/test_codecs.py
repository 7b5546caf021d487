"""Bytes become commands, requests and refusals; never exceptions."""

from __future__ import annotations

import json
import math
import struct
import sys

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.messages import cdr
from yahboomd.core.messages.codecs import (
    MAX_PAYLOAD_BYTES,
    ReceivedCommand,
    Refusal,
    decode_command,
    decode_set_pose,
    encode,
    encode_reply,
    encoding_name,
    encoding_of,
    estop_by,
    is_not_pressed,
    is_release_attempt,
)
from yahboomd.core.messages.native import (
    MAX_LABEL,
    EstopRequest,
    PoseSample,
    ServiceReply,
    SetPoseRequest,
    VelocityCommand,
)
from yahboomd.ros2.messages import ros2_encoders

pack = msgspec.msgpack.encode
finite = st.floats(min_value=-1e12, max_value=1e12)
speeds = st.floats(min_value=-100.0, max_value=100.0)
stamps_ns = st.integers(1, 2**63 - 1)
words = st.text("aZ_ é漢\U0001f600\0", max_size=5)

# JSON- and MessagePack-shaped chaos around the fields that matter.
leaves = st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats() | words
keys = st.sampled_from(
    ["vx", "vy", "wz", "linear", "angular", "x", "y", "z", "stamp_ns", "source", "engaged"]
)
branches = st.dictionaries(keys, leaves, max_size=4) | st.lists(leaves, max_size=3)
trees = st.dictionaries(keys, leaves | branches, max_size=6)


def reason(payload):
    result = decode_command(payload)
    assert isinstance(result, Refusal), result
    assert result.detail
    return result.reason


def twist(*six, order="<"):
    return bytes((0, order == "<", 0, 0)) + struct.pack(f"{order}6d", *six)


# --- accepted --------------------------------------------------------------------------------


@given(speeds, speeds, speeds, stamps_ns, words, st.sampled_from(["json", "msgpack"]))
def test_a_command_survives_the_round_trip(vx, vy, wz, stamp_ns, source, encoding):
    sent = VelocityCommand(vx=vx, vy=vy, wz=wz, stamp_ns=stamp_ns, source=source)
    if source is not None:
        source = "".join(c if c.isprintable() else "?" for c in source)
    assert decode_command(encode(sent, encoding)) == ReceivedCommand(
        vx=vx, vy=vy, wz=wz, stamp_ns=stamp_ns, source=source, encoding=encoding
    )


@pytest.mark.parametrize(
    ("payload", "encoding"),
    [
        (b'{"vx": 0.5, "wz": -1}', "json"),
        (b' \r\n\t{"vx": 5e-1, "vy": 0, "wz": -1.0, "colour": [{"deep": null}]}', "json"),
        (b'{"linear": {"x": 0.5, "y": 0, "z": 9}, "angular": {"x": 9, "z": -1}}', "json"),
        (b'{"linear": {"x": 0.5}, "angular": {"z": -1}, "header": {}}', "json"),
        (b'{"vx": 7, "vx": 0.5, "wz": -1}', "json"),
        (b'{"vx": 0.5, "wz": -1, "linear": {"x": 3}, "stamp_ns": 0}', "json"),
        (pack({"vx": 0.5, "wz": -1}), "msgpack"),
        (b"\x82\xa2vx\xca\x3f\x00\x00\x00\xa2wz\xff", "msgpack"),
        (b"\xde\x00\x02" + pack({"vx": 0.5, "wz": -1})[1:], "msgpack"),
        (b"\xdf\x00\x00\x00\x02" + pack({"vx": 0.5, "wz": -1})[1:], "msgpack"),
        (pack({"linear": {"x": 0.5, "y": 0}, "angular": {"z": -1.0}}), "msgpack"),
        (twist(0.5, 0, 0, 0, 0, -1), "cdr"),
        (twist(0.5, 0, 0, 0, 0, -1, order=">"), "cdr"),
    ],
)
def test_every_encoding_and_shape_gives_the_same_command(payload, encoding):
    assert decode_command(payload) == ReceivedCommand(vx=0.5, wz=-1.0, encoding=encoding)


@pytest.mark.parametrize(
    ("payload", "velocity"),
    [
        (b'{"vx": 1}', (1, 0, 0)),
        (b'{"vy": 1}', (0, 1, 0)),
        (b'{"wz": 0}', (0, 0, 0)),
        (b'{"linear": {"y": 2}}', (0, 2, 0)),
        (b'{"angular": {"z": 3}}', (0, 0, 3)),
    ],
)
def test_one_velocity_is_enough_and_the_others_are_zero(payload, velocity):
    got = decode_command(payload)
    assert isinstance(got, ReceivedCommand)
    assert (got.vx, got.vy, got.wz) == velocity


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
def test_a_stop_is_a_command(encoding):
    got = decode_command(encode(VelocityCommand(), encoding))
    assert got == ReceivedCommand(vx=0.0, vy=0.0, wz=0.0, encoding=encoding)


def test_a_stamped_twist_brings_its_stamp():
    header = struct.pack("<iII10sxx", 1_700_000_000, 250_000_000, 10, b"base_link")
    body = header + struct.pack("<6d", 1, 0, 0, 0, 0, 0)
    got = decode_command(cdr.HEADER_LE + body)
    assert got == ReceivedCommand(vx=1.0, stamp_ns=1_700_000_000_250_000_000, encoding="cdr")


def test_a_long_source_label_is_cut_not_refused():
    got = decode_command(encode(VelocityCommand(vx=1.0, source="x" * 999), "json"))
    assert isinstance(got, ReceivedCommand)
    assert got.source == "x" * MAX_LABEL


# --- refused ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "payload",
    [
        b"{}",
        b'{"Vx": 1, "linear": {"z": 1}}',
        b'{"linear": null, "angular": {}}',
        b'{"stamp_ns": 5, "source": "me"}',
        pack({}),
        pack({"angular": {"x": 1.0}}),
    ],
)
def test_a_command_without_a_velocity_is_refused(payload):
    assert reason(payload) == "no_velocity"


@pytest.mark.parametrize(
    "payload",
    [
        b'{"vx": NaN}',
        b'{"vx": 1, "wz": -Infinity}',
        b'{"vy": Infinity}',
        b'{"vx": 1e999}',
        b'{"vx": -1e999}',
        b'{"vx": 1' + b"0" * 400 + b"}",
        b'  {"linear": {"x": NaN}, "angular": {"z": 0}}',
        pack({"vx": math.nan}),
        pack({"vx": 1, "vy": math.inf}),
        b"\x81\xa2wz\xca\xff\x80\x00\x00",
        pack({"linear": {"x": 1.0}, "angular": {"z": math.nan}}),
        twist(math.nan, 0, 0, 0, 0, 0),
        twist(0, 0, 0, 0, 0, math.inf, order=">"),
        twist(0, 0, math.nan, 0, 0, 0),
        twist(math.inf, -math.inf, 0, 0, 0, 0),
    ],
)
def test_a_number_that_is_not_finite_is_refused_as_such(payload):
    assert reason(payload) == "not_finite"


@pytest.mark.parametrize(
    "payload",
    [
        b'{"vx": "1"}',
        b'{"vx": true}',
        b'{"vx": null}',
        b'{"vx": [1]}',
        b'{"linear": [1, 2]}',
        b'{"vx": 1, "stamp_ns": 1.5}',
        b'{"vx": 1, "stamp_ns": -1}',
        b'{"vx": 1, "stamp_ns": 9223372036854775808}',
        b'{"vx": 1, "stamp_ns": ' + b"9" * 300 + b"}",
        b'{"vx": 1, "source": 7}',
        pack({"vx": "fast"}),
        pack({"vx": b"1"}),
        pack({1: 2}),
        b"\x81\xc4\x02vx\x01",
    ],
)
def test_a_field_of_the_wrong_type_is_refused(payload):
    assert reason(payload) == "wrong_type"


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{",
        b'{"vx": 1',
        b'{"vx": 1} {"vx": 2}',
        b'{"vx": 01}',
        b"{'vx': 1}",
        b'{"source": "\xff", "vx": 1}',
        b'{"source": "\\ud800", "vx": 1}',
        b'{"vx":1,"a":' + b"[" * 4000,
        pytest.param(
            b'{"vx":1,"a":' + b"[" * 2000 + b"]" * 2000 + b"}",
            marks=pytest.mark.skipif(sys.version_info >= (3, 14), reason="3.14 reads it"),
        ),
        b'{"vx":1,"a":' + b'{"a":' * 700,
        b"\x81",
        b"\x81\xa2vx",
        b"\x81\xa2vx\xc1",
        b"\x82\xa2vx\x01\xa1a" + b"\x91" * 4000,
        b"\x81\xa6source\xa1\xff",
        b"\xdf\xff\xff\xff\xff",
        pack({"vx": 1}) + b"\x00",
        b"\x00",
        b"\x00\x01\x00\x00",
        twist(1, 0, 0, 0, 0, 0)[:-1],
        twist(1, 0, 0, 0, 0, 0) + b"\x00",
        b"\x00\x07\x00\x00" + bytes(48),
    ],
)
def test_broken_bytes_are_refused_as_malformed(payload):
    assert reason(payload) == "malformed"


@pytest.mark.parametrize(
    "payload", [b"hello", b"[1, 2]", b"   ", b"1.5", b"\xef\xbb\xbf{}", b"\x90", b"\xc0", b"\xff"]
)
def test_bytes_that_start_like_no_encoding_are_refused(payload):
    assert reason(payload) == "unknown_encoding"


def test_a_payload_is_read_up_to_its_bound_and_refused_beyond():
    command = b'{"vx": 1}'
    room = MAX_PAYLOAD_BYTES - len(command)
    assert isinstance(decode_command(b" " * room + command), ReceivedCommand)
    assert reason(b" " * (room + 1) + command) == "oversize"


# --- whatever arrives -----------------------------------------------------------------------


def check(payload):
    result = decode_command(payload)
    assert isinstance(result, ReceivedCommand | Refusal)
    if isinstance(result, ReceivedCommand):
        assert all(map(math.isfinite, (result.vx, result.vy, result.wz)))
        assert result.stamp_ns is None or 0 < result.stamp_ns < 2**63
        assert result.encoding == encoding_of(payload)
        encode(result, "json")  # an accepted message can be reported
    assert isinstance(decode_set_pose(payload), SetPoseRequest | Refusal)
    assert isinstance(is_release_attempt(payload), bool)
    assert isinstance(is_release_attempt(payload, query=True), bool)


@given(st.binary(max_size=120), st.sampled_from([b"", b"{", b" {", b"\x81", b"\xde", b"\x00\x01"]))
def test_no_bytes_make_the_decoders_raise(data, start):
    check(start + data)


@given(trees)
def test_no_map_makes_the_decoders_raise(tree):
    check(pack(tree))
    check(json.dumps(tree).encode())  # with NaN and Infinity, as many libraries write them


@given(trees, st.integers(0, 400), st.binary(min_size=1, max_size=3))
def test_no_damaged_map_makes_the_decoders_raise(tree, place, damage):
    for whole in (pack(tree), json.dumps(tree).encode()):
        check(whole[:place] + damage + whole[place + len(damage) :])
        check(whole[:place])


# --- services -------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
def test_a_pose_request_survives_the_round_trip(encoding):
    request = SetPoseRequest(x=1.0, y=-2.0, theta=0.5, covariance=(1, 0, 0, 0, 1, 0, 0, 0, 1))
    assert decode_set_pose(encode(request, encoding)) == request


@pytest.mark.parametrize(
    ("payload", "expected"),
    [
        (b'{"x": 1, "y": 2}', "wrong_type"),
        (b'{"x": 1, "y": 2, "theta": NaN}', "not_finite"),
        (pack({"x": 1, "y": 2, "theta": math.inf}), "wrong_type"),
        (pack({"x": 0, "y": 0, "theta": 0, "covariance": [math.nan] * 9}), "wrong_type"),
        (b'{"x": 0, "y": 0, "theta": 0, "covariance": [1, 2]}', "wrong_type"),
        (b'{"x":0,"y":0,"theta":0,"covariance":[1,0,0,0,-1,0,0,0,1]}', "wrong_type"),
        (ros2_encoders.trigger_request(), "unknown_encoding"),
        (b"", "malformed"),
        (b"{" * (MAX_PAYLOAD_BYTES + 1), "oversize"),
    ],
)
def test_a_bad_pose_request_is_refused_with_its_reason(payload, expected):
    result = decode_set_pose(payload)
    assert isinstance(result, Refusal)
    assert result.reason == expected


@pytest.mark.parametrize(
    "payload",
    [
        b'{"engaged": false}',
        b'\n {"engaged":false, "why": "fixed"}',
        pack({"engaged": False}),
        encode(EstopRequest(engaged=False), "json"),
    ],
)
def test_a_well_formed_false_is_a_release_attempt(payload):
    assert is_release_attempt(payload)
    assert is_release_attempt(payload, query=True)


@pytest.mark.parametrize(
    ("payload", "by"),
    [
        (b'{"by": "the red button"}', "the red button"),
        (b'{"engaged": true, "by": "yahboomd drive"}', "yahboomd drive"),
        (pack({"by": "the red button"}), "the red button"),
        (b"", ""),
        (b"stop", ""),
        (b"[1]", ""),
        (b'{"by": 3}', ""),
        (b'{"by": "red \\u001b[2J"}', ""),
        (b'{"by": "' + b"x" * 100 + b'"}', "x" * 64),
    ],
)
def test_who_asks_for_the_estop_is_read_where_it_is_a_printable_text(payload, by):
    assert estop_by(payload) == by


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"stop",
        b"{}",
        b'{"engaged": true}',
        b'{"engaged": 0}',
        b'{"engaged": null}',
        b'{"engaged": "false"}',
        b'{"engaged": false',
        b'{"engaged": false} ,',
        b'{"engaged": false, "engaged": true}',
        b'{"Engaged": false}',
        b'{"engaged": false, "x": "\xac"}',
        b'{"engaged": false, "\xac": 1}',
        b"\x82\xa7engaged\xc2\x80\xc0",
        b"false",
        pack({"engaged": 0}),
        pack({"engaged": False})[:-1],
        b'{"engaged": false, "x": "' + b"x" * MAX_PAYLOAD_BYTES + b'"}',
        ros2_encoders.boolean(True),
        cdr.HEADER_LE + b"\x02",
        cdr.HEADER_LE,
    ],
)
def test_everything_else_engages(payload):
    assert not is_release_attempt(payload)
    assert not is_release_attempt(payload, query=True)


def test_a_false_set_bool_is_a_release_attempt_only_as_a_query():
    assert is_release_attempt(ros2_encoders.boolean(False), query=True)
    assert not is_release_attempt(ros2_encoders.boolean(False))


@pytest.mark.parametrize("head", [cdr.HEADER_LE, b"\x00\x00\x00\x00"])
@pytest.mark.parametrize("padding", [b"", bytes(3)])
def test_a_false_bool_says_that_the_estop_is_not_pressed(head, padding):
    assert is_not_pressed(head + b"\x00" + padding)
    assert not is_not_pressed(head + b"\x01" + padding)


@pytest.mark.parametrize(
    "payload",
    [b"", b'{"engaged": false}', b"false", b"\x00", cdr.HEADER_LE, cdr.HEADER_LE + bytes(5)],
)
def test_nothing_but_a_false_bool_says_so(payload):
    assert not is_not_pressed(payload)


def test_a_reply_speaks_the_encoding_that_was_asked_for(oracle):
    reply = ServiceReply(success=True, message="done", data={"x": 1})
    assert json.loads(encode_reply(reply, "json")) == {
        "success": True,
        "message": "done",
        "data": {"x": 1},
    }
    assert msgspec.msgpack.decode(encode_reply(reply, "msgpack"), type=ServiceReply) == reply
    assert oracle.decode("std_srvs/srv/SetBool_Response", encode_reply(reply, "cdr")) == {
        "success": True,
        "message": "done",
    }


def test_encodings_are_named_with_the_message():
    assert encoding_name(PoseSample, "json") == "application/json;PoseSample"
    assert encoding_name(PoseSample, "msgpack") == "application/msgpack;PoseSample"
    assert encoding_name("nav_msgs/msg/Odometry", "cdr") == "application/cdr;nav_msgs/msg/Odometry"


@given(st.binary(max_size=8))
def test_an_encoding_is_detected_by_the_first_byte_behind_white_space(payload):
    text = payload.lstrip(b" \t\r\n")
    expected = None
    if text.startswith(b"{"):
        expected = "json"
    elif payload and (0x80 <= payload[0] <= 0x8F or payload[0] in {0xDE, 0xDF}):
        expected = "msgpack"
    elif payload.startswith(b"\0"):
        expected = "cdr"
    assert encoding_of(payload) == expected


def test_a_label_with_control_characters_is_taken_without_them() -> None:
    payload = b'{"vx": 0.1, "source": "\\u001b[2J joystick"}'
    command = decode_command(payload)
    assert isinstance(command, ReceivedCommand)
    assert command.source == "?[2J joystick"
