"""A robot and the daemon behind the real bridge, used by ROS 2 itself on its default middleware."""

import math
from itertools import permutations

import pytest
from ros_peers import DISTROS

pytestmark = pytest.mark.realtime

ODOM_READERS = ("rviz", "nav2", "nav2_newer", "robot_localization")
SERVICES = {
    "/yahboomd/estop": "std_srvs/srv/SetBool",
    "/yahboomd/estop/reset": "std_srvs/srv/Trigger",
    "/yahboomd/odometry/reset": "std_srvs/srv/Trigger",
}


def estopped(node, wanted):
    return node.message("/estopped", lambda m: m["data"] is wanted, f"estopped {wanted}")


def heard_by(node, consumer, topic, wanted=lambda _: True):
    """The next message that the subscription of one consumer gets."""
    event = node.await_event(
        lambda e: (e.get("topic"), e.get("consumer")) == (topic, consumer) and wanted(e["message"]),
        f"{topic} as {consumer} subscribes to it",
    )
    return event["message"]


def speed(message):
    return message["twist"]["twist"]["linear"]["x"]


def of_one_reading(node):
    """Odometry and transform with one stamp, as soon as both were heard.

    A node that does not keep up, or that DDS connects topic by topic, misses single messages.
    """
    events = [event for event in list(node.events) if event["event"] == "message"]
    poses = {
        str(event["message"]["header"]["stamp"]): event["message"]
        for event in events
        if event["topic"] == "/odom"
    }
    for event in events:
        if event["topic"] == "/tf":
            (transform,) = event["message"]["transforms"]
            if odom := poses.get(str(transform["header"]["stamp"])):
                return odom, transform
    return None


def drives(node):
    node.message("/odom", lambda m: speed(m) > 0.15, "the robot to drive")


def press(node, eventually, data, times=1):
    """Publish on the button's topic, as soon as the bridge hears it."""

    def pressed():
        node.order("press", data=data, times=times)
        event = node.await_event(lambda e: e["event"] in ("pressed", "unheard"), "a press")
        return event["event"] == "pressed"

    eventually(pressed, "the bridge to hear the button")


def stop(node, eventually):
    """Press the button until it was received, and see the effect.

    DDS may lose samples that are published before the reader knows its writer as well.
    """

    def stopped():
        press(node, eventually, True)
        heard = [event for event in list(node.events) if event.get("topic") == "/estopped"]
        return any(event["message"]["data"] for event in heard)

    eventually(stopped, "the emergency stop")
    estopped(node, True)


@pytest.mark.parametrize("distro", ["jazzy", pytest.param("kilted", marks=pytest.mark.nightly)])
def test_it_drives_stops_by_a_topic_and_sees_so(
    ros_bridge, start_ros_node, robot, eventually, distro
):
    robot(ros_bridge.endpoint)
    node = start_ros_node(distro=distro)
    estopped(node, False)
    node.order("drive", vx=0.2, hz=20)
    drives(node)
    # A button that publishes all the time that it is not pressed.
    press(node, eventually, False, times=20)
    node.events.clear()
    drives(node)
    stop(node, eventually)
    node.message("/odom", lambda m: abs(speed(m)) < 0.001, "the robot to stand")
    press(node, eventually, False, times=20)
    node.events.clear()
    # Latched: who comes later knows at once, and it is not released.
    estopped(start_ros_node(distro=distro), True)


@pytest.mark.nightly
@pytest.mark.parametrize("distro", DISTROS)
def test_every_topic_reaches_the_subscriptions_of_usual_programs(
    ros_bridge, start_ros_node, robot, eventually, distro
):
    """Those of RViz, Nav2, tf2_ros, robot_localization, robot_state_publisher and panels."""
    robot(ros_bridge.endpoint, 'ros2.stamped_commands=["cmd_vel"]')
    node = start_ros_node(*ODOM_READERS, "tf2_ros", "robot_state_publisher", "panel", distro=distro)
    node.order("drive", vx=0.2, wz=0.2, hz=20, stamped=True)
    for consumer in ODOM_READERS:
        odom = heard_by(node, consumer, "/odom", lambda m: speed(m) > 0.1)
        assert (odom["header"]["frame_id"], odom["child_frame_id"]) == ("odom", "base_link")
    odom, transform = eventually(lambda: of_one_reading(node), "a transform beside its odometry")
    assert transform["transform"]["rotation"] == odom["pose"]["pose"]["orientation"]
    assert transform["child_frame_id"] == "base_link"
    (laser,) = heard_by(node, "tf2_ros", "/tf_static")["transforms"]
    assert (laser["header"]["frame_id"], laser["child_frame_id"]) == ("base_link", "laser")
    assert laser["transform"]["rotation"]["z"] == pytest.approx(math.sqrt(0.5))
    joints = heard_by(node, "robot_state_publisher", "/joint_states", lambda m: m["position"][0])
    assert joints["name"] == ["left_wheel_joint", "right_wheel_joint"]
    assert heard_by(node, "panel", "/battery_state")["present"]
    levels = heard_by(node, "panel", "/diagnostics")["status"]
    assert "yahboomd: base" in {entry["name"] for entry in levels}
    assert not heard_by(node, "panel", "/estopped")["data"]


def stamp_of(line):
    return line["stamp"]["sec"], line["stamp"]["nanosec"]


@pytest.mark.nightly
def test_events_are_lines_of_the_log_and_a_late_node_gets_the_last_alone(
    ros_bridge, start_ros_node, robot, eventually, client
):
    """The fault that docs/ros2.md tells of: the bridge keeps one line, whatever the depth is."""
    driven, early = robot(ros_bridge.endpoint), start_ros_node("log")
    early.message("/rosout", what="a line from before")

    def line_of(kind):
        return early.message("/rosout", lambda m: m["function"] == kind, f"the line of {kind}")

    def engaged():
        # DDS may lose samples that are published before the reader knows its writer as well.
        press(early, eventually, True, times=3)
        return "Emergency stop engaged" in driven.daemon.output

    eventually(engaged, "the emergency stop")
    line = line_of("estop")
    assert (line["name"], line["level"]) == ("yahboomd", 30)
    assert line["msg"].startswith("Emergency stop engaged by a sample")
    onlooker = client("client", driven.endpoint)
    eventually(lambda: onlooker.ask("yahboomd/estop/reset")["success"], "the release")
    newest = stamp_of(line_of("estop_released"))
    for _ in range(2):
        # A busy machine has events of its own, which may follow.
        assert stamp_of(start_ros_node("log").message("/rosout")) >= newest


@pytest.mark.nightly
def test_nodes_that_come_late_get_what_is_latched_and_what_flows(ros_bridge, start_ros_node, robot):
    robot(ros_bridge.endpoint)
    for distro in DISTROS:
        node = start_ros_node("rviz", "tf2_ros", "panel", distro=distro)
        heard_by(node, "tf2_ros", "/tf_static")
        heard_by(node, "panel", "/estopped")
        heard_by(node, "rviz", "/odom")


@pytest.mark.nightly
@pytest.mark.parametrize("order", list(permutations(("bridge", "daemon", "node"))), ids="-".join)
def test_daemon_bridge_and_node_may_start_again_in_any_order(
    ros_bridge, start_ros_node, robot, eventually, order
):
    driven = robot(ros_bridge.endpoint)
    node = start_ros_node()
    node.order("drive", vx=0.2, hz=20)
    drives(node)
    for each in order:
        if each == "bridge":
            ros_bridge.stop()
            ros_bridge.start()
        elif each == "daemon":
            assert driven.daemon.end() == 0
            driven.start_daemon()
        else:
            node.close()
            node = start_ros_node()
            node.order("drive", vx=0.2, hz=20)
    node.events.clear()
    drives(node)
    stop(node, eventually)


@pytest.mark.nightly
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
    estopped(start_ros_node(settings=settings), False)


@pytest.mark.nightly
@pytest.mark.parametrize("distro", DISTROS)
def test_a_service_call_through_the_bridge_hangs_and_does_nothing(
    ros_bridge, start_ros_node, robot, distro
):
    """The fault that docs/ros2.md warns of: once it is mended, the warning can go."""
    robot(ros_bridge.endpoint)
    node = start_ros_node(distro=distro, settings=("CALL_TIMEOUT_S=3",))
    estopped(node, False)
    for service, kind in SERVICES.items():
        data = {"data": True} if kind.endswith("SetBool") else {}
        node.order("call", service=service, **data)
        ended = node.await_event(
            lambda e: e["event"] in ("reply", "no_reply", "no_service"), "the end of the call"
        )
        assert ended["event"] == "no_reply"
    estopped(node, False)
