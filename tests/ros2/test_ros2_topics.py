"""The tables of ROS 2's topics and services hold every one, with types that are known."""

from __future__ import annotations

from make.schema_files import cdr_samples
from yahboomd.ros2 import ros2_topics
from yahboomd.ros2.messages.rcl_interfaces import ParameterServer
from yahboomd.ros2.messages.ros2_names import TWIST, TWIST_STAMPED, TYPE_HASHES
from yahboomd.ros2.ros2_topics import RECEIVED, ROS_TOPICS, SERVICES

TYPES = {
    *(topic.ros_type for topic in ROS_TOPICS.values()),
    *(TWIST, TWIST_STAMPED),
    *RECEIVED.values(),
    *SERVICES.values(),
}


def test_every_name_of_a_topic_is_in_the_table() -> None:
    named = {
        value
        for name, value in vars(ros2_topics).items()
        if name.isupper() and isinstance(value, str)
    }
    assert named == ROS_TOPICS.keys()


def test_every_type_is_known_and_has_a_sample() -> None:
    parameters = ParameterServer({}, {}, "").services.values()
    assert TYPES | {ros_type for ros_type, _ in parameters} == TYPE_HASHES.keys()
    sampled = {sample.ros_type.partition("_Re")[0] for sample in cdr_samples.CDR.values()}
    assert sampled == TYPES
