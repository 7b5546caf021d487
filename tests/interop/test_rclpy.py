"""A robot and the daemon behind the real bridge, used by ROS 2 itself on its default middleware."""

import pytest

pytestmark = pytest.mark.realtime


def estopped(node, wanted):
    return node.message("/estopped", lambda m: m["data"] is wanted, f"estopped {wanted}")


def press(node, eventually, data, times=1):
    """Publish on the button's topic, as soon as the bridge hears it."""

    def pressed():
        node.order("press", data=data, times=times)
        event = node.await_event(lambda e: e["event"] in ("pressed", "unheard"), "a press")
        return event["event"] == "pressed"

    eventually(pressed, "the bridge to hear the button")


def test_it_drives_stops_by_a_topic_and_sees_so(ros_bridge, start_ros_node, robot, eventually):
    robot(ros_bridge.endpoint)
    node = start_ros_node()
    estopped(node, False)
    node.order("drive", vx=0.2, hz=20)
    node.message("/odom", lambda m: m["vx"] > 0.15, "the robot to drive")
    # A button that says all the time that it is not pressed.
    press(node, eventually, False, times=20)
    node.events.clear()
    node.message("/odom", lambda m: m["vx"] > 0.15, "the robot to drive on")
    press(node, eventually, True)
    estopped(node, True)
    node.message("/odom", lambda m: abs(m["vx"]) < 0.001, "the robot to stand")
    press(node, eventually, False, times=20)
    node.events.clear()
    # Latched: who comes later knows at once, and it is not released.
    estopped(start_ros_node(), True)


@pytest.mark.parametrize(
    "settings",
    [(), ("ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",), ("ROS_LOCALHOST_ONLY=1",)],
    ids=["default", "range", "older"],
)
def test_a_bridge_on_loopback_is_found_however_nodes_of_this_machine_discover(
    ros_bridge, start_ros_node, robot, settings
):
    """As docs/security.md advises."""
    robot(ros_bridge.endpoint)
    estopped(start_ros_node(*settings), False)


def test_a_service_call_through_the_bridge_hangs_and_engages_nothing(
    ros_bridge, start_ros_node, robot
):
    """The fault that docs/ros2.md warns of: once it is mended, the warning can go."""
    robot(ros_bridge.endpoint)
    node = start_ros_node()
    estopped(node, False)
    node.order("call", service="/yahboomd/estop", data=True)
    ended = node.await_event(
        lambda e: e["event"] in ("reply", "no_reply", "no_service"), "the end of the call"
    )
    assert ended["event"] == "no_reply"
    estopped(node, False)
