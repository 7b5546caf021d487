"""The ROS 2 plane as a bridge, an rmw_zenoh graph and nodes see it on real sessions."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from typing import Any

import pytest
import zenoh
import zenoh.ext
from real_robot import Client, RealRobot, wait_for
from ros_oracle import Oracle
from zenoh_fixtures import ZenohApp, eventually

from yahboomd.bus.bus import Bus
from yahboomd.bus.options import BusOptions
from yahboomd.bus.subscriptions import Arrival
from yahboomd.config import read
from yahboomd.daemon.ros2_plane import AttachedOutlet, BridgeWay, NativeWay, topics
from yahboomd.messages import cdr, ros2
from yahboomd.messages.native import ServiceReply
from yahboomd.messages.ros2 import Qos

pytestmark = pytest.mark.realtime
LATCHED = Qos(latched=True, depth=1)


BRIDGES = "@/*/@ros2_lv/**"
"""The query of a bridge that joins."""

ROS_GRAPH = "@ros2_lv/7/**"
"""The query of a node that joins the graph of its domain."""


def tokens(app: ZenohApp, joining: str = BRIDGES) -> set[str]:
    replies = app.session.liveliness().get(joining)
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}


async def test_topics_show_before_anybody_uses_them(bus: Bus, app: ZenohApp) -> None:
    way = BridgeWay(bus, "jazzy")
    way.publisher("odom", ros2.ODOMETRY, Qos())
    way.publisher("tf_static", ros2.TF_MESSAGE, LATCHED)
    way.subscriber("cmd_vel/teleop", ros2.TWIST, Qos(reliable=False, depth=1))
    way.service("yahboomd/estop", ros2.SET_BOOL)

    hashes = {each: ros2.TYPE_HASHES[each] for each in (ros2.ODOMETRY, ros2.TF_MESSAGE, ros2.TWIST)}
    lv = f"@/{bus.zid}/@ros2_lv"
    odom, static, twist = hashes.values()
    wanted = {
        f"{lv}/MP/bot1§odom/nav_msgs§msg§Odometry/:1:0:0,10:typehash={odom};",
        f"{lv}/MP/bot1§tf_static/tf2_msgs§msg§TFMessage/:1:1:0,1:typehash={static};",
        f"{lv}/MS/bot1§cmd_vel§teleop/geometry_msgs§msg§Twist/:0:0:0,1:typehash={twist};",
        f"{lv}/SS/bot1§yahboomd§estop/std_srvs§srv§SetBool",
    }
    await eventually(lambda: len(tokens(app)) >= len(wanted))
    assert tokens(app) == wanted


async def test_humble_has_no_type_hashes(bus: Bus, app: ZenohApp) -> None:
    BridgeWay(bus, "humble").publisher("odom", ros2.ODOMETRY, Qos())
    await eventually(lambda: tokens(app))
    (token,) = tokens(app)
    assert token.endswith("/:1:0:0,10")


async def test_samples_go_out_on_the_plain_key(bus: Bus, app: ZenohApp) -> None:
    outlet = BridgeWay(bus, "jazzy").publisher("odom", ros2.ODOMETRY, Qos())
    assert not outlet.has_subscribers
    heard = app.collect("bot1/odom")
    await eventually(lambda: outlet.has_subscribers)
    outlet.put(b"\0\1\0\0cdr")
    (sample,) = await eventually(lambda: heard)
    assert sample.priority == zenoh.Priority.DATA_HIGH
    assert sample.congestion_control == zenoh.CongestionControl.DROP
    assert sample.payload.to_bytes() == b"\0\1\0\0cdr"
    assert str(sample.encoding) == "application/cdr;nav_msgs/msg/Odometry"
    assert sample.attachment is None


async def test_who_comes_late_is_given_what_is_latched(bus: Bus, app: ZenohApp) -> None:
    outlet = BridgeWay(bus, "jazzy").publisher("tf_static", ros2.TF_MESSAGE, LATCHED)
    outlet.put(b"old frames")
    outlet.put(b"frames")
    heard: list[bytes] = []
    # As the bridge subscribes to a latched topic.
    subscriber = zenoh.ext.declare_advanced_subscriber(
        app.session,
        "bot1/tf_static",
        lambda sample: heard.append(sample.payload.to_bytes()),
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    )
    await eventually(lambda: heard)
    assert heard == [b"frames"]
    subscriber.undeclare()


async def test_a_namespace_that_is_no_name_in_ros_is_not_announced(
    zenoh_app: Callable[..., ZenohApp], bus: Bus
) -> None:
    endpoint = bus.options.listen[0]
    async with Bus(
        BusOptions(mode="client", listen=(), connect=(endpoint,), namespace="my-bot")
    ) as odd:
        way = BridgeWay(odd, "jazzy")
        outlet = way.publisher("odom", ros2.ODOMETRY, Qos())
        way.service("yahboomd/estop", ros2.SET_BOOL)
        app = zenoh_app("client", endpoint)
        heard = app.collect("my-bot/odom")
        await eventually(lambda: outlet.has_subscribers)
        outlet.put(b"flows all the same")
        await eventually(lambda: heard)
        assert tokens(app) == set()


WALL_NS = 1_700_000_000_123_456_789
DISTRO = "jazzy"


@pytest.fixture
def way(bus: Bus) -> NativeWay:
    return NativeWay(bus, domain_id=7, distro=DISTRO, wall_ns=lambda: WALL_NS)


def key(topic: str, ros_type: str) -> str:
    return f"7/bot1/{topic}/{ros2.dds_type(ros_type)}/{ros2.TYPE_HASHES[ros_type]}"


async def test_the_node_shows_with_all_that_it_has(bus: Bus, way: NativeWay, app: ZenohApp) -> None:
    way.publisher("odom", ros2.ODOMETRY, Qos())
    way.subscriber("cmd_vel", ros2.TWIST, Qos(reliable=False, depth=1), lambda _: None)
    way.service("yahboomd/estop", ros2.SET_BOOL, lambda at, answer: None)
    await eventually(lambda: len(tokens(app, ROS_GRAPH)) == 4)
    ours, hashes = f"@ros2_lv/7/{bus.zid}/0", ros2.TYPE_HASHES
    odom = f"%bot1%odom/nav_msgs::msg::dds_::Odometry_/{hashes[ros2.ODOMETRY]}"
    commands = f"%bot1%cmd_vel/geometry_msgs::msg::dds_::Twist_/{hashes[ros2.TWIST]}"
    estop = f"%bot1%yahboomd%estop/std_srvs::srv::dds_::SetBool_/{hashes[ros2.SET_BOOL]}"
    assert tokens(app, ROS_GRAPH) == {
        f"{ours}/0/NN/%/%bot1/yahboomd",
        f"{ours}/1/MP/%/%bot1/yahboomd/{odom}/::,10:,:,:,,",
        f"{ours}/2/MS/%/%bot1/yahboomd/{commands}/2::,1:,:,:,,",
        f"{ours}/3/SS/%/%bot1/yahboomd/{estop}/::,10:,:,:,,",
    }


async def test_every_sample_has_an_attachment_of_33_bytes(way: NativeWay, app: ZenohApp) -> None:
    odom = way.publisher("odom", ros2.ODOMETRY, Qos())
    joints = way.publisher("joint_states", ros2.JOINT_STATE, Qos())
    heard = (
        app.collect(key("odom", ros2.ODOMETRY)),
        app.collect(key("joint_states", ros2.JOINT_STATE)),
    )
    await eventually(lambda: odom.has_subscribers and joints.has_subscribers)
    for payload in (b"one", b"two", b"three"):
        odom.put(payload)
    joints.put(b"joints")
    await eventually(lambda: len(heard[0]) == 3 and heard[1])
    attached = [sample.attachment.to_bytes() for samples in heard for sample in samples]
    assert [len(each) for each in attached] == [33] * 4
    parsed = [ros2.parse_attachment(each) for each in attached]
    assert [each.sequence for each in parsed] == [1, 2, 3, 1]
    assert {each.stamp_ns for each in parsed} == {WALL_NS}
    assert {each[16] for each in attached} == {16}
    gids = [each.gid for each in parsed]
    assert gids[0] == gids[1] == gids[2] != gids[3]


async def test_who_comes_late_is_given_what_is_latched_with_its_attachment(
    way: NativeWay, app: ZenohApp
) -> None:
    outlet = way.publisher("tf_static", ros2.TF_MESSAGE, Qos(latched=True, depth=1))
    outlet.put(b"frames")
    heard: list[tuple[bytes, bytes]] = []
    subscriber = zenoh.ext.declare_advanced_subscriber(
        app.session,
        key("tf_static", ros2.TF_MESSAGE),
        lambda s: heard.append((s.payload.to_bytes(), s.attachment.to_bytes())),
        history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
    )
    ((payload, attached),) = await eventually(lambda: heard)
    assert payload == b"frames"
    assert ros2.parse_attachment(attached) is not None
    subscriber.undeclare()


async def test_both_kinds_of_commands_are_heard_and_one_is_announced(
    way: NativeWay, app: ZenohApp
) -> None:
    arrived: list[Arrival] = []
    way.subscriber("cmd_vel", ros2.TWIST, Qos(depth=1), arrived.extend, also=ros2.TWIST_STAMPED)
    gid = bytes(range(16))
    for ros_type in (ros2.TWIST, ros2.TWIST_STAMPED):
        await app.reach(key("cmd_vel", ros_type))
        app.session.put(
            key("cmd_vel", ros_type), b"\0command", attachment=ros2.attachment(9, WALL_NS, gid)
        )
    await eventually(lambda: len(arrived) == 2)
    assert {ros2.parse_attachment(each.attachment or b"") for each in arrived} == {
        ros2.Attachment(9, WALL_NS, gid)
    }
    announced = "".join(tokens(app, ROS_GRAPH))
    assert "::Twist_" in announced
    assert "TwistStamped" not in announced


async def test_an_answer_repeats_the_number_and_the_gid_of_its_request(
    bus: Bus, way: NativeWay, app: ZenohApp
) -> None:
    def offer(at, answer) -> None:
        bus.serve(
            at,
            lambda request: answer(request, ServiceReply(success=True, message="done")),
            fallback=lambda reason, request: answer(
                request, ServiceReply(success=False, message=reason)
            ),
        )

    way.service("yahboomd/odometry/reset", ros2.TRIGGER, offer)
    service = key("yahboomd/odometry/reset", ros2.TRIGGER)
    gid = bytes(range(16))
    (reply,) = await app.ask(
        service, payload=cdr.trigger_request(), attachment=ros2.attachment(42, 1, gid)
    )
    assert reply.ok.payload.to_bytes() == cdr.service_response(True, "done")
    assert reply.ok.attachment.to_bytes() == ros2.attachment(42, WALL_NS, gid)
    # One without attachment, or a strange one, is no client of rmw_zenoh's, and is answered too.
    for attachment in (None, b"x" * 33, b"x" * 5000):
        (reply,) = await app.ask(service, attachment=attachment)
        assert len(reply.ok.attachment.to_bytes()) == ros2.ATTACHMENT_BYTES
        assert cdr.is_cdr(reply.ok.payload.to_bytes())


def test_numbers_go_on_while_samples_are_dropped() -> None:
    class Full:
        has_subscribers = True

        def __init__(self) -> None:
            self.attachments: list[bytes] = []

        def put(self, payload: bytes, attachment: bytes | None = None) -> bool:
            self.attachments.append(attachment or b"")
            return False

    publisher = Full()
    outlet = AttachedOutlet(publisher, bytes(16), lambda: WALL_NS)
    assert [outlet.put(b"") for _ in range(3)] == [False] * 3
    assert [ros2.parse_attachment(each).sequence for each in publisher.attachments] == [1, 2, 3]


TYPES = {
    "odom": ros2.ODOMETRY,
    "tf": ros2.TF_MESSAGE,
    "joint_states": ros2.JOINT_STATE,
    "battery_state": ros2.BATTERY_STATE,
    "diagnostics": ros2.DIAGNOSTIC_ARRAY,
    "estopped": ros2.BOOL,
}
LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",z=0.1}]'


def native_key(topic: str, ros_type: str) -> str:
    return f"0/{topic}/{ros2.dds_type(ros_type)}/{ros2.TYPE_HASHES[ros_type]}"


class Graph:
    """Everything that comes on the keys of ROS 2, as it came."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.samples: dict[str, list[zenoh.Sample]] = {}
        for topic, ros_type in TYPES.items():
            self.hear(topic)
            self.hear(native_key(topic, ros_type))

    def hear(self, key: str) -> None:
        self.session.declare_subscriber(key, self.samples.setdefault(key, []).append)

    def payloads(self, topic: str) -> list[bytes]:
        return [sample.payload.to_bytes() for sample in list(self.samples[topic])]

    def ask(self, key: str, payload: bytes, attachment: bytes | None = None) -> zenoh.Sample:
        for reply in self.session.get(key, payload=payload, attachment=attachment, timeout=20.0):
            assert reply.ok is not None
            return reply.ok
        pytest.fail(f"{key} did not answer")


@pytest.fixture
def run(real_robot: Callable[..., RealRobot]) -> Callable[..., RealRobot]:
    """Starts a robot with settings such as ``ros2.rmw_zenoh=true``."""

    def start(*settings: str) -> RealRobot:
        return real_robot(run=[part for each in settings for part in ("--set", each)])

    return start


def stamp_ns(header: dict[str, Any]) -> int:
    return int(header["stamp"]["sec"]) * 1_000_000_000 + int(header["stamp"]["nanosec"])


def test_ros_reads_every_byte_and_the_same_readings_as_the_native_plane(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run("ros2.rmw_zenoh=true", "ros2.frame_prefix=bot1/")
    app = client("client", robot.endpoint)
    graph = Graph(app.session)
    app.in_state("standing")
    app.drive(cdr.twist((0.25, 0.0, 0.0, 0.0, 0.0, 0.6)), 1.0)
    robot.settled_truth()
    wait_for(lambda: all(graph.samples[topic] for topic in TYPES), "every topic")
    for topic, ros_type in TYPES.items():
        for payload in graph.payloads(topic):
            # A message that ROS writes in the very bytes that it was read from.
            message = oracle.store.deserialize_cdr(payload, ros_type)
            assert bytes(oracle.store.serialize_cdr(message, ros_type)) == payload

    odometry = [oracle.decode(ros2.ODOMETRY, payload) for payload in graph.payloads("odom")]
    transforms = [
        oracle.decode(ros2.TF_MESSAGE, payload)["transforms"] for payload in graph.payloads("tf")
    ]
    stamps = [stamp_ns(transform["header"]) for (transform,) in transforms]
    assert stamps == sorted(set(stamps)), "tf2 takes a repeated transform for a mistake"
    poses = {pose["stamp_ns"]: pose for pose in app.samples["pose"]}
    same = [each for each in odometry if stamp_ns(each["header"]) in poses]
    assert len(same) > 50
    for each in same:
        native, there = poses[stamp_ns(each["header"])], each["pose"]["pose"]["position"]
        assert (there["x"], there["y"]) == (native["x"], native["y"])
        assert each["pose"]["covariance"][35] == native["covariance"][8]
        assert each["header"]["frame_id"] == "bot1/odom"
        assert each["child_frame_id"] == "bot1/base_link"
    assert any(each["twist"]["twist"]["linear"]["x"] > 0.2 for each in same)


def test_natively_the_same_bytes_go_out_with_an_attachment(
    run: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = run("ros2.rmw_zenoh=true", LASER)
    graph = Graph(client("client", robot.endpoint).session)
    wait_for(lambda: len(graph.samples["odom"]) > 20, "odometry")
    for topic, ros_type in TYPES.items():
        key = native_key(topic, ros_type)
        wait_for(lambda key=key: graph.samples[key], topic)
        attached = [
            ros2.parse_attachment(sample.attachment.to_bytes())
            for sample in list(graph.samples[key])
            if sample.attachment is not None
        ]
        assert None not in attached
        first = attached[0].sequence
        numbers = [each.sequence for each in attached]
        assert numbers == list(range(first, first + len(numbers)))
        assert len({each.gid for each in attached}) == 1
    odom = native_key("odom", ros2.ODOMETRY)
    wait_for(
        lambda: len(set(graph.payloads("odom")) & set(graph.payloads(odom))) > 20, "the same bytes"
    )


def test_a_late_subscriber_gets_the_static_frames(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run("ros2.rmw_zenoh=true", LASER)
    app = client("client", robot.endpoint)
    app.in_state("standing")
    for key in ("tf_static", native_key("tf_static", ros2.TF_MESSAGE)):
        heard: list[bytes] = []
        subscriber = zenoh.ext.declare_advanced_subscriber(
            app.session,
            key,
            lambda sample, heard=heard: heard.append(sample.payload.to_bytes()),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
        )
        wait_for(lambda heard=heard: heard, key)
        (laser,) = oracle.decode(ros2.TF_MESSAGE, heard[0])["transforms"]
        assert (laser["header"]["frame_id"], laser["child_frame_id"]) == ("base_link", "laser")
        assert laser["transform"]["translation"] == {"x": 0.0, "y": 0.0, "z": 0.1}
        subscriber.undeclare()
    # A subscriber that knows nothing of caches waits a second at most.
    plain: list[zenoh.Sample] = []
    app.session.declare_subscriber("tf_static", plain.append)
    wait_for(lambda: plain, "frames for a plain subscriber")


def test_what_ros_asks_is_answered_in_cdr(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run("ros2.rmw_zenoh=true")
    app = client("client", robot.endpoint)
    app.in_state("standing")
    graph = Graph(app.session)
    gid = bytes(range(16))
    asked = ros2.attachment(5, 1, gid)
    for key, ros_type, payload, success, state in (
        ("yahboomd/estop", ros2.SET_BOOL, cdr.boolean(True), True, "estopped"),
        ("yahboomd/estop", ros2.SET_BOOL, cdr.boolean(False), False, "estopped"),
        ("yahboomd/estop/reset", ros2.TRIGGER, cdr.trigger_request(), True, "standing"),
        ("yahboomd/odometry/reset", ros2.TRIGGER, cdr.trigger_request(), True, "standing"),
        # The least that the bridge leaves of a request: the header of its encoding.
        ("yahboomd/odometry/reset", ros2.TRIGGER, cdr.HEADER_LE, True, "standing"),
    ):
        through_bridge = graph.ask(key, payload)
        native = graph.ask(native_key(key, ros_type), payload, asked)
        for answer in (through_bridge, native):
            reply = oracle.decode(f"{ros_type}_Response", answer.payload.to_bytes())
            assert reply["success"] is success
            assert reply["message"]
        assert native.attachment is not None
        returned = ros2.parse_attachment(native.attachment.to_bytes())
        assert (returned.sequence, returned.gid) == (5, gid)
        app.in_state(state)


def test_the_estop_is_a_topic_too_and_a_button_that_is_not_pressed_changes_nothing(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run("ros2.rmw_zenoh=true")
    app = client("client", robot.endpoint)
    app.in_state("standing")
    graph = Graph(app.session)
    pressed, let_go = cdr.boolean(True), cdr.boolean(False)
    attached = ros2.attachment(1, 1, bytes(range(16)))

    def idle() -> int:
        return int(app.latest("status")["command"]["estop_not_pressed"])

    def said() -> list[bool]:
        return [oracle.decode(ros2.BOOL, payload)["data"] for payload in graph.payloads("estopped")]

    def press(key: str, payload: bytes) -> None:
        app.session.put(key, payload, attachment=attached if key != "yahboomd/estop" else None)

    for key in ("yahboomd/estop", native_key("yahboomd/estop", ros2.BOOL)):
        wait_for(lambda: said()[-1:] == [False], "not engaged")
        before = idle()
        for _ in range(50):
            press(key, let_go)
        wait_for(lambda before=before: idle() == before + 50, "samples that ask for nothing")
        assert app.latest("status")["state"] == "standing"
        # However often the bridge delivers it.
        for _ in range(32):
            press(key, pressed)
        app.in_state("estopped")
        wait_for(lambda: said()[-1:] == [True], "engaged")
        press(key, let_go)
        wait_for(lambda before=before: idle() == before + 51, "a button that was let go")
        assert app.latest("status")["state"] == "estopped"
        assert app.latest("status")["command"]["release_refused"] == 0
        graph.ask("yahboomd/estop/reset", cdr.trigger_request())
        app.in_state("standing")


def test_a_node_with_another_clock_drives_and_is_named_in_the_diagnostics(
    run: Callable[..., RealRobot], client: Callable[..., Client], oracle: Oracle
) -> None:
    robot = run()
    app = client("client", robot.endpoint)
    graph = Graph(app.session)
    app.in_state("standing")

    def warned() -> list[dict[str, Any]]:
        command = cdr.twist_stamped(time.time_ns() - 3_200_000_000, "", (0.2, 0, 0, 0, 0, 0))
        app.session.put("cmd_vel", command)
        entries = [
            entry
            for payload in graph.payloads("diagnostics")[-1:]
            for entry in oracle.decode(ros2.DIAGNOSTIC_ARRAY, payload)["status"]
        ]
        return [each for each in entries if each["name"] == "yahboomd: commands" and each["level"]]

    (entry,) = wait_for(warned, "a warning")
    assert entry["level"] == 1
    assert entry["message"].startswith("cmd_vel: Its clock is 3.2")
    assert "behind" in entry["message"]
    robot.daemon.says("behind this machine's")
    app.in_state("driving")
    assert app.latest("status")["command"]["clock_offset_s"]["cmd_vel"] == pytest.approx(
        -3.2, abs=0.1
    )


def test_native_commands_drive_and_one_that_was_held_up_does_not(
    run: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = run("ros2.rmw_zenoh=true", "ros2.bridge=false")
    app = client("client", robot.endpoint)
    app.in_state("standing")
    key = native_key("cmd_vel", ros2.TWIST)
    sequence = 0

    def say(stamp_ns: int) -> None:
        nonlocal sequence
        sequence += 1
        attached = ros2.attachment(sequence, stamp_ns, bytes(16))
        app.session.put(key, cdr.twist((0.2, 0, 0, 0, 0, 0)), attachment=attached)

    def driving() -> bool:
        say(time.time_ns())
        return bool(app.latest("status")["command"].get("accepted", 0) > 20)

    wait_for(driving, "commands to be obeyed")
    assert app.latest("status")["driver"] == "cmd_vel"
    say(time.time_ns() - 5_000_000_000)
    wait_for(lambda: app.latest("status")["command"].get("out_of_order"), "a refusal")


def test_names_follow_the_configuration() -> None:
    given = [
        "ros2.odom=false",
        "ros2.publish_tf=false",
        "ros2.joint_states_topic=wheels/joints",
        "ros2.frame_prefix=bot1_",
        "odometry.child_frame_id=base_footprint",
        'ros2.joint_names={left="left_drive"}',
        "zenoh.namespace=bot1",
        LASER,
    ]
    chosen = topics(read(None, environ={}, overrides=given).config)
    assert (chosen.odom, chosen.transform) == ("", False)
    assert chosen.joint_states == "wheels/joints"
    assert (chosen.frame_id, chosen.child_frame_id) == ("bot1_odom", "bot1_base_footprint")
    assert chosen.joints == ("left_drive", "right_wheel_joint")
    assert [(each.parent, each.child) for each in chosen.static] == [
        ("bot1_base_link", "bot1_laser")
    ]
    assert chosen.static[0].rotation == (0.0, 0.0, 0.0, 1.0)
    assert chosen.hardware_id == "bot1"


@pytest.mark.parametrize(
    ("given", "hardware_id"),
    [
        ([], socket.gethostname()),
        (["zenoh.namespace=bot1"], "bot1"),
        (["zenoh.namespace=bot1", "ros2.hardware_id=serial 7"], "serial 7"),
    ],
)
def test_a_robot_has_its_own_name_in_the_diagnostics(given: list[str], hardware_id: str) -> None:
    assert topics(read(None, environ={}, overrides=given).config).hardware_id == hardware_id
