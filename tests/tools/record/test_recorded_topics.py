"""The keys that are recorded, and their types."""

from __future__ import annotations

import json

import msgspec
import pytest

from yahboomd.core.config import Config, read
from yahboomd.core.daemon.publisher import PUBLISHED
from yahboomd.ros2.messages import ros2_encoders
from yahboomd.ros2.ros2_topics import ROS_TOPICS
from yahboomd.tools.record.recorded_topics import Recorded, facts_of, recorded


def by_key(*overrides: str) -> dict[str, Recorded]:
    config = read(None, environ={}, overrides=overrides).config
    return {each.key: each for each in recorded(config)}


def test_every_key_that_the_daemon_publishes_or_takes_commands_on_is_recorded() -> None:
    found = by_key()
    assert set(found) == set(PUBLISHED) | set(ROS_TOPICS) | {
        "cmd_vel",
        "cmd_vel/teleop",
        "cmd_vel/web",
        "cmd_vel/moves",
        "yahboomd/estop",
    }


def test_topics_have_the_names_and_types_that_are_configured() -> None:
    found = by_key("ros2.odom_topic=wheel/odom", "ros2.stamped_commands=cmd_vel")
    assert found["wheel/odom"].ros_type == "nav_msgs/msg/Odometry"
    assert found["cmd_vel"].ros_type == "geometry_msgs/msg/TwistStamped"


def test_without_the_bridge_the_keys_are_those_of_rmw_zenoh_or_none() -> None:
    native = by_key("ros2.bridge=false", "ros2.rmw_zenoh=true", "zenoh.namespace=bot1")
    (odom,) = [key for key in native if "Odometry" in key]
    assert odom.startswith("/0/bot1/odom/nav_msgs::msg::dds_::Odometry_/RIHS01_")
    assert native[odom].topic == "odom"
    assert not any(
        each.ros_type and not each.message for each in by_key("ros2.bridge=false").values()
    )


def test_a_message_goes_to_the_channel_of_its_encoding() -> None:
    command = by_key()["cmd_vel"]
    as_json = command.channel(b'{"vx": 0.5}')
    assert as_json is not None
    assert as_json[0].schema == "VelocityCommand"
    assert json.loads(as_json[0].schema_text)["type"] == "object"
    packed = command.channel(msgspec.msgpack.encode({"vx": 0.5}))
    assert packed is not None
    assert packed == (as_json[0], b'{"vx":0.5}')
    as_cdr = command.channel(ros2_encoders.twist((0.5, 0, 0, 0, 0, 0)))
    assert as_cdr is not None
    assert as_cdr[0].topic == "/cmd_vel"
    assert "Vector3 linear" in as_cdr[0].schema_text


@pytest.mark.parametrize("payload", [b"", b"\x00\x01\x00\x00", b"hello", b"\x81\xc1"])
def test_bytes_that_are_no_message_have_no_channel(payload: bytes) -> None:
    assert by_key()["yahboomd/pose"].channel(payload) is None


def test_the_facts_are_what_makes_poses_of_counts_and_no_credentials() -> None:
    facts = facts_of(Config().as_data())
    assert json.loads(facts["chassis"])["wheel_separation_m"] == 0.15
    assert not {"zenoh", "estop", "log"} & set(facts)
