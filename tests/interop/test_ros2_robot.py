"""A simulated robot and the daemon, each a process, driven and watched by real ROS 2 peers."""

import math

import pytest
from ros_peers import HERE, built, start_peer
from zenoh_fixtures import free_endpoint

from yahboomd.ros2.messages import ros2_names

pytestmark = pytest.mark.realtime

OUT = {
    "/odom": ros2_names.ODOMETRY,
    "/tf": ros2_names.TF_MESSAGE,
    "/tf_static": ros2_names.TF_MESSAGE,
    "/joint_states": ros2_names.JOINT_STATE,
    "/battery_state": ros2_names.BATTERY_STATE,
    "/diagnostics": ros2_names.DIAGNOSTIC_ARRAY,
    "/estopped": ros2_names.BOOL,
}
IN = ("/cmd_vel", "/cmd_vel/teleop")
TRIGGERS = ("/yahboomd/estop/reset", "/yahboomd/odometry/reset")


def distance(message, x, y):
    position = message["pose"]["pose"]["position"]
    return math.hypot(position["x"] - x, position["y"] - y)


def level_of(message, what):
    return {entry["name"]: entry["level"] for entry in message["status"]}[f"yahboomd: {what}"]


def reading_of(node):
    """The odometry and the transforms of one reading; a busy machine loses single ones."""
    odoms = {}

    def both_came(event):
        if event["event"] != "message":
            return False
        message = event["message"]
        if event["topic"] == "/odom" and distance(message, 0.0, 0.0) > 0.2:
            odoms[tuple(message["header"]["stamp"].values())] = message
        return event["topic"] == "/tf" and stamp_of(message) in odoms

    def stamp_of(message):
        return tuple(message["transforms"][0]["header"]["stamp"].values())

    tf = node.await_event(both_came, "the transform of a reading")["message"]
    return odoms[stamp_of(tf)], tf["transforms"]


def sees_the_robot_move(node, robot):
    """Drives by the node's /cmd_vel, and reads its topics."""
    node.order("drive", vx=0.25, wz=0.3, hz=20)
    odom, (transform,) = reading_of(node)
    assert (odom["header"]["frame_id"], odom["child_frame_id"]) == ("odom", "base_link")
    assert transform["child_frame_id"] == "base_link"
    where = odom["pose"]["pose"]
    assert transform["transform"]["translation"] == where["position"]
    assert transform["transform"]["rotation"] == where["orientation"]
    joints = node.message("/joint_states", lambda m: m["position"][0] > 1.0)
    assert joints["name"] == ["left_wheel_joint", "right_wheel_joint"]
    assert node.message("/battery_state")["present"]
    node.message("/diagnostics", lambda m: level_of(m, "base") == 0, "a base that is well")
    node.order("rest")
    truth = robot.settled_truth()
    node.message(
        "/odom", lambda m: distance(m, truth.x, truth.y) < 0.01, "the pose to be the truth"
    )


def is_stopped_and_released(node):
    assert node.call("/yahboomd/estop", data=True)["reply"]["success"]
    node.message("/diagnostics", lambda m: level_of(m, "base") == 1, "the e-stop to show")
    refused = node.call("/yahboomd/estop", data=False)["reply"]
    assert not refused["success"]
    assert "yahboomd/estop/reset" in refused["message"]
    for service in TRIGGERS:
        reply = node.call(service)["reply"]
        assert reply["success"], reply["message"]


def laser_of(node):
    (laser,) = node.message("/tf_static")["transforms"]
    assert laser["header"]["frame_id"] == "base_link"
    assert laser["transform"]["rotation"]["z"] == pytest.approx(math.sqrt(0.5))
    return laser["child_frame_id"]


@pytest.mark.parametrize("stamped", [False, pytest.param(True, marks=pytest.mark.nightly)])
def test_a_dds_node_drives_through_the_bridge_and_sees_it(bridge, dds_node, robot, stamped):
    settings = ['ros2.stamped_commands=["cmd_vel"]'] if stamped else []
    driven = robot(bridge.endpoint, *settings)
    assert laser_of(dds_node) == "laser"
    order = dds_node.order
    dds_node.order = lambda do, **what: order(do, **what, stamped=stamped)
    sees_the_robot_move(dds_node, driven)
    is_stopped_and_released(dds_node)


@pytest.mark.nightly
def test_behind_the_bridge_a_publisher_of_the_other_type_is_not_heard_and_diagnostics_say_so(
    bridge, dds_node, start_dds_node, robot, eventually
):
    onlooker = start_dds_node("-")
    robot(bridge.endpoint)
    eventually(lambda: "rt/cmd_vel" in onlooker.graph()["subscribers"], "what we listen to")
    dds_node.order("drive", vx=0.25, hz=50, stamped=True)
    shown = eventually(lambda: onlooker.graph()["publishers"].get("rt/cmd_vel"), "the publisher")
    assert shown == ros2_names.dds_type(ros2_names.TWIST_STAMPED)
    assert onlooker.graph()["subscribers"]["rt/cmd_vel"] == ros2_names.dds_type(ros2_names.TWIST)

    def commands(message):
        return next(e for e in message["status"] if e["name"] == "yahboomd: commands")

    warned = dds_node.message("/diagnostics", lambda m: commands(m)["level"] == 1, "a warning")
    words = commands(warned)["message"]
    assert "geometry_msgs/msg/TwistStamped on cmd_vel" in words
    assert 'Add "cmd_vel" to ros2.stamped_commands' in words
    assert {"key": "accepted", "value": "0"} in commands(warned)["values"]


@pytest.mark.nightly
def test_all_topics_show_behind_the_bridge_before_anybody_uses_them(
    bridge, start_dds_node, robot, eventually
):
    onlooker = start_dds_node("-")
    robot(bridge.endpoint)
    types = {**OUT, "/rosout": ros2_names.LOG}
    requests = {f"rq{service}Request" for service in ("/yahboomd/estop", *TRIGGERS)}
    wanted = {f"rt{topic}" for topic in (*IN, "/yahboomd/odometry/set_pose")} | requests

    def shown():
        graph = onlooker.graph()
        mine = {t.removeprefix("rt"): k for t, k in graph["publishers"].items() if t[:3] == "rt/"}
        return mine if len(mine) >= len(types) and wanted <= graph["subscribers"].keys() else None

    mine = eventually(shown, "every topic")
    assert mine == {topic: ros2_names.dds_type(ros_type) for topic, ros_type in types.items()}


@pytest.mark.nightly
def test_a_dds_node_that_starts_late_gets_the_static_frames(bridge, start_dds_node, robot):
    robot(bridge.endpoint)
    for _ in range(2):
        assert laser_of(start_dds_node("/tf_static")) == "laser"


@pytest.mark.nightly
def test_bridge_and_daemon_may_restart(bridge, dds_node, robot):
    driven = robot(bridge.endpoint)
    dds_node.order("drive", vx=0.1, wz=0.4, hz=20)
    dds_node.message("/odom", lambda m: distance(m, 0.0, 0.0) > 0.02, "the robot to move")
    bridge.stop()
    bridge.start()
    far = distance(dds_node.message("/odom"), 0.0, 0.0)
    dds_node.message("/odom", lambda m: distance(m, 0.0, 0.0) > far + 0.02, "it to move on")
    assert driven.daemon.end() == 0
    driven.start_daemon()
    dds_node.message("/odom", lambda m: distance(m, 0.0, 0.0) < 0.01, "it to begin again")
    dds_node.message("/odom", lambda m: distance(m, 0.0, 0.0) > 0.02, "it to move again")
    assert laser_of(dds_node) == "laser"
    dds_node.order("rest")
    driven.settled_truth()
    is_stopped_and_released(dds_node)


@pytest.fixture
def reconfigure(bridge, tmp_path):
    """Restarts the bridge with one change of its configuration."""

    def again(old, new):
        text = bridge.config.read_text()
        assert old in text
        bridge.stop()
        bridge.config = tmp_path / "bridge.json5"
        bridge.config.write_text(text.replace(old, new))
        bridge.start()

    return again


@pytest.mark.nightly
def test_a_robot_with_a_bridge_of_its_own_has_plain_names_there(
    bridge, reconfigure, dds_node, robot
):
    reconfigure('// namespace: "/bot1"', 'namespace: "/bot1"')
    driven = robot(bridge.endpoint, "zenoh.namespace=bot1", "ros2.frame_prefix=bot1/")
    dds_node.order("drive", vx=0.25, wz=0.3, hz=20)
    odom = dds_node.message("/odom", lambda m: distance(m, 0.0, 0.0) > 0.2, "the robot to move")
    assert odom["header"]["frame_id"] == "bot1/odom"
    assert odom["child_frame_id"] == "bot1/base_link"
    dds_node.order("rest")
    driven.settled_truth()
    is_stopped_and_released(dds_node)


@pytest.mark.nightly
def test_robots_behind_one_bridge_are_distinguished_by_their_namespaces(
    bridge, reconfigure, start_dds_node, robot, eventually
):
    reconfigure('"/cmd_vel", "/cmd_vel/teleop"', '"/bot./cmd_vel"')
    reconfigure('"/odom"', '"/bot./odom"')
    onlooker = start_dds_node("-")
    for name in ("bot1", "bot2"):
        robot(bridge.endpoint, f"zenoh.namespace={name}")
    eventually(
        lambda: (
            {"rt/bot1/odom", "rt/bot2/odom"} <= onlooker.graph()["publishers"].keys()
            and {"rt/bot1/cmd_vel", "rt/bot2/cmd_vel"} <= onlooker.graph()["subscribers"].keys()
        ),
        "both robots",
    )


def test_a_native_node_drives_without_a_bridge_and_sees_it(
    router, native_node, start_native_node, start_pair, robot
):
    onlooker, talk = start_native_node(), start_pair(router.endpoint)
    driven = robot(router.endpoint, "ros2.bridge=false", "ros2.rmw_zenoh=true")
    sees_the_robot_move(native_node, driven)
    is_stopped_and_released(native_node)
    assert laser_of(native_node) == "laser"
    talk("beside the robot")
    for topic in ("/odom", "/tf", "/joint_states"):
        heard = [event for event in list(onlooker.events) if event.get("topic") == topic]
        numbers = [event["attachment"]["sequence"] for event in heard]
        assert len(numbers) > 50
        assert numbers == list(range(numbers[0], numbers[-1] + 1)), "every sample arrives"


@pytest.mark.nightly
def test_native_nodes_need_no_router(start_native_node, robot, tmp_path, request):
    """They also hear each other, a program of others among them."""
    driven = robot(free_endpoint(), "ros2.bridge=false", "ros2.rmw_zenoh=true")
    command = [str(built("sdk")), str(HERE / "sdk_node.py"), driven.endpoint, "0", "listener"]
    listener = start_peer(command, tmp_path / "listener.log")
    request.addfinalizer(listener.close)
    node, onlooker = (start_native_node(driven.endpoint) for _ in range(2))
    sees_the_robot_move(node, driven)
    listener.await_event(lambda e: e.get("topic") == "/cmd_vel", "the other's commands")
    listener.await_event(lambda e: e.get("topic") == "/odom", "the odometry")
    is_stopped_and_released(node)
    assert laser_of(onlooker) == "laser"
    assert {each["name"] for each in onlooker.graph()["nodes"]} >= {
        "yahboomd",
        "native_peer",
        "listener",
    }


@pytest.mark.nightly
def test_the_node_shows_in_a_native_graph_with_all_that_it_has(
    router, native_node, start_pair, robot, eventually
):
    talk = start_pair(router.endpoint)
    robot(router.endpoint, "ros2.rmw_zenoh=true", "zenoh.namespace=bot1")

    def seen():
        graph = native_node.graph()
        services = {service["name"] for service in graph["services"]}
        topics = {topic["name"] for topic in graph["topics"]}
        wanted = {f"/bot1{topic}" for topic in OUT}
        return graph if f"/bot1{TRIGGERS[-1]}" in services and wanted <= topics else None

    graph = eventually(seen, "our services and topics")
    assert {"name": "yahboomd", "namespace": "/bot1"} in graph["nodes"]
    talk("beside the robot")
    assert {each["name"] for each in graph["nodes"]} >= {"native_peer", "one", "two"}
    topics = {topic["name"]: topic for topic in graph["topics"]}
    for topic, ros_type in OUT.items():
        assert topics[f"/bot1{topic}"]["type"] == ros2_names.dds_type(ros_type)
        assert topics[f"/bot1{topic}"]["publishers"] == 1
    assert all(topics[f"/bot1{topic}"]["subscribers"] == 1 for topic in IN)


@pytest.mark.nightly
def test_a_native_node_that_starts_late_gets_the_static_frames(
    router, start_native_node, start_pair, robot
):
    robot(router.endpoint, "ros2.rmw_zenoh=true")
    talk = start_pair(router.endpoint)
    for _ in range(2):
        assert laser_of(start_native_node()) == "laser"
    talk("beside those that came late")
