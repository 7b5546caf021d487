"""The native messages have exactly the fields that the bus promises."""

from __future__ import annotations

import json

import msgspec
import pytest
from msgspec import structs

from make.schema_files.samples import MESSAGES
from yahboomd.core.messages import native
from yahboomd.core.messages.codecs import encode
from yahboomd.core.model import Event, OdometryEstimate, Pose2d, Twist2d

FIELDS = {
    "VelocityCommand": "vx vy wz stamp_ns source",
    "RosVelocityCommand": "linear angular",
    "PoseSample": "stamp_ns seq frame_id child_frame_id x y theta covariance",
    "TwistSample": "stamp_ns seq frame_id vx vy wz covariance",
    "WheelsSample": "stamp_ns seq names ticks position_rad speed_m_s command_m_s",
    "ImuSample": "stamp_ns seq frame_id gyro_rad_s acceleration_m_s2 gyro_bias_rad_s theta "
    "gyro_variance acceleration_variance gyro_bias_variance theta_variance magnetic_t",
    "BatterySample": "stamp_ns volts",
    "EventSample": "stamp_ns kind severity message wheel data",
    "StatusSample": "stamp_ns state driver since_ns why board link command bus driver_since_ns "
    "wheels wheels_since_ns reasons",
    "EstopRequest": "engaged by",
    "SetPoseRequest": "x y theta covariance",
    "ServiceReply": "success message data",
}

READ = [name for name in FIELDS if name.endswith("Sample")]

ESTIMATE = OdometryEstimate(
    stamp_ns=5,  # monotonic: never to be seen on the bus
    pose=Pose2d(x=1.0, y=2.0, theta=7.0),
    twist=Twist2d(vx=0.5, vy=0.25, wz=-1.0),
    pose_covariance=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0),
    twist_covariance=(9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0),
    motor_ticks=(100, -200),
    motor_position_rad=(0.5, -1.0),
    motor_speed_m_s=(0.1, -0.2),
)


def wire(message):
    return json.loads(encode(message, "json"))


def test_every_message_has_exactly_its_fields():
    assert {
        name: " ".join(message.__struct_fields__) for name, message in MESSAGES.items()
    } == FIELDS


@pytest.mark.parametrize("name", [*READ, "ServiceReply"])
def test_a_field_that_a_daemon_may_leave_out_is_not_known_by_default(name):
    defaults = {
        field.name: field.default
        for field in structs.fields(MESSAGES[name])
        # Version 0.1 has it: nothing is returned.
        if (name, field.name) != ("ServiceReply", "data")
    }
    assert set(defaults.values()) <= {msgspec.NODEFAULT, None}


def test_words_of_a_set_are_text_in_what_others_read():
    for name in READ:
        assert "enum" not in json.dumps(msgspec.json.schema(MESSAGES[name]))


@pytest.mark.parametrize("message", MESSAGES.values(), ids=MESSAGES)
def test_messages_are_frozen_described_and_let_others_grow(message):
    assert message.__struct_config__.frozen
    assert message.__doc__
    assert not message.__struct_config__.forbid_unknown_fields


def test_the_pose_is_the_estimates_with_wall_time():
    sample = native.pose_sample(
        ESTIMATE, stamp_ns=1_700, seq=3, frame_id="odom", child_frame_id="base"
    )
    assert wire(sample) == {
        "stamp_ns": 1_700,
        "seq": 3,
        "frame_id": "odom",
        "child_frame_id": "base",
        "x": 1.0,
        "y": 2.0,
        "theta": 7.0,
        "covariance": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0],
    }


def test_the_twist_is_the_estimates_with_the_same_stamp_and_number():
    sample = native.twist_sample(ESTIMATE, stamp_ns=1_700, seq=3, frame_id="base")
    assert wire(sample) == {
        "stamp_ns": 1_700,
        "seq": 3,
        "frame_id": "base",
        "vx": 0.5,
        "vy": 0.25,
        "wz": -1.0,
        "covariance": [9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0],
    }


def test_the_wheels_are_the_estimates_and_what_was_commanded():
    sample = native.wheels_sample(
        ESTIMATE, stamp_ns=1_700, seq=3, names=("left", "right"), command_m_s=(0.2, -0.3)
    )
    assert wire(sample) == {
        "stamp_ns": 1_700,
        "seq": 3,
        "names": ["left", "right"],
        "ticks": [100, -200],
        "position_rad": [0.5, -1.0],
        "speed_m_s": [0.1, -0.2],
        "command_m_s": [0.2, -0.3],
    }


def test_an_event_leaves_out_what_it_does_not_have():
    event = Event(kind="board_reset", severity="warning", message="It reset.")
    assert wire(native.event_sample(event, stamp_ns=9)) == {
        "stamp_ns": 9,
        "kind": "board_reset",
        "severity": "warning",
        "message": "It reset.",
    }
    whole = Event(kind="no_counts", severity="error", message="!", wheel="left", data={"ticks": 0})
    assert wire(native.event_sample(whole, stamp_ns=9)) == {
        "stamp_ns": 9,
        "kind": "no_counts",
        "severity": "error",
        "message": "!",
        "wheel": "left",
        "data": {"ticks": 0},
    }


def test_a_reply_always_has_its_three_fields():
    assert wire(native.ServiceReply(success=False, message="no")) == {
        "success": False,
        "message": "no",
        "data": {},
    }


def test_status_groups_hold_counters_by_source_and_reason():
    status = native.StatusSample(
        stamp_ns=1,
        state="standing",
        driver=None,
        since_ns=1,
        why="No command.",
        board={"problems": ["zero wheel diameter"]},
        link={},
        command={"sources": {"cmd_vel": {"refused": {"not_finite": 2}}}},
        bus={"routers": 1},
    )
    for encoding, decode in (("json", msgspec.json.decode), ("msgpack", msgspec.msgpack.decode)):
        assert decode(encode(status, encoding), type=native.StatusSample) == status
