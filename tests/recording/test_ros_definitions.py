"""The definitions in recordings are those of ROS 2 itself."""

from __future__ import annotations

import pytest
from rosbags.typesys import Stores, get_typestore

from yahboomd.ros2.messages.ros2_names import TWIST, TWIST_STAMPED
from yahboomd.ros2.ros2_topics import RECEIVED, ROS_TOPICS
from yahboomd.tools.record.ros_definitions import definition

TYPES = {*(topic.ros_type for topic in ROS_TOPICS.values()), TWIST, TWIST_STAMPED}
TYPES |= set(RECEIVED.values())


@pytest.mark.parametrize("ros_type", sorted(TYPES))
def test_every_type_on_the_bus_has_its_definition(ros_type: str) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef(ros_type, ros_version=2)
    assert definition(ros_type) == text


def test_an_unknown_type_has_none() -> None:
    assert definition("my_msgs/msg/Own") is None
