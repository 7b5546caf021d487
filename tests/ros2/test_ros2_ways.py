"""Each way into ROS 2 on real sessions, as a bridge and an rmw_zenoh graph see it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import zenoh
from zenoh_fixtures import ZenohApp, eventually, late_subscriber

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.messages import cdr
from yahboomd.core.messages.native import ServiceReply
from yahboomd.ros2.messages import ros2_encoders, ros2_names
from yahboomd.ros2.messages.ros2_names import Qos
from yahboomd.ros2.ros2_ways import AttachedOutlet, BridgeWay, NativeWay

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
    way.publisher("odom", ros2_names.ODOMETRY, Qos())
    way.publisher("tf_static", ros2_names.TF_MESSAGE, LATCHED)
    way.subscriber("cmd_vel/teleop", ros2_names.TWIST, Qos(reliable=False, depth=1))
    way.service("yahboomd/estop", ros2_names.SET_BOOL)

    hashes = {
        each: ros2_names.TYPE_HASHES[each]
        for each in (ros2_names.ODOMETRY, ros2_names.TF_MESSAGE, ros2_names.TWIST)
    }
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
    BridgeWay(bus, "humble").publisher("odom", ros2_names.ODOMETRY, Qos())
    await eventually(lambda: tokens(app))
    (token,) = tokens(app)
    assert token.endswith("/:1:0:0,10")


async def test_samples_go_out_on_the_plain_key(bus: Bus, app: ZenohApp) -> None:
    outlet = BridgeWay(bus, "jazzy").publisher("odom", ros2_names.ODOMETRY, Qos())
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
    outlet = BridgeWay(bus, "jazzy").publisher("tf_static", ros2_names.TF_MESSAGE, LATCHED)
    outlet.put(b"old frames")
    outlet.put(b"frames")
    with late_subscriber(app.session, "bot1/tf_static", newest=1) as heard:
        await eventually(lambda: heard)
        assert [sample.payload.to_bytes() for sample in heard] == [b"frames"]


async def test_a_namespace_that_is_no_name_in_ros_is_not_announced(
    zenoh_app: Callable[..., ZenohApp], bus: Bus
) -> None:
    endpoint = bus.options.listen[0]
    async with Bus(
        BusOptions(mode="client", listen=(), connect=(endpoint,), namespace="my-bot")
    ) as odd:
        way = BridgeWay(odd, "jazzy")
        outlet = way.publisher("odom", ros2_names.ODOMETRY, Qos())
        way.service("yahboomd/estop", ros2_names.SET_BOOL)
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
    return f"7/bot1/{topic}/{ros2_names.dds_type(ros_type)}/{ros2_names.TYPE_HASHES[ros_type]}"


async def test_the_node_shows_with_all_that_it_has(bus: Bus, way: NativeWay, app: ZenohApp) -> None:
    way.publisher("odom", ros2_names.ODOMETRY, Qos())
    way.subscriber("cmd_vel", ros2_names.TWIST, Qos(reliable=False, depth=1), lambda _: None)
    way.service("yahboomd/estop", ros2_names.SET_BOOL, lambda at, answer: None)
    await eventually(lambda: len(tokens(app, ROS_GRAPH)) == 4)
    ours, hashes = f"@ros2_lv/7/{bus.zid}/0", ros2_names.TYPE_HASHES
    odom = f"%bot1%odom/nav_msgs::msg::dds_::Odometry_/{hashes[ros2_names.ODOMETRY]}"
    commands = f"%bot1%cmd_vel/geometry_msgs::msg::dds_::Twist_/{hashes[ros2_names.TWIST]}"
    estop = f"%bot1%yahboomd%estop/std_srvs::srv::dds_::SetBool_/{hashes[ros2_names.SET_BOOL]}"
    assert tokens(app, ROS_GRAPH) == {
        f"{ours}/0/NN/%/%bot1/yahboomd",
        f"{ours}/1/MP/%/%bot1/yahboomd/{odom}/::,10:,:,:,,",
        f"{ours}/2/MS/%/%bot1/yahboomd/{commands}/2::,1:,:,:,,",
        f"{ours}/3/SS/%/%bot1/yahboomd/{estop}/::,10:,:,:,,",
    }


async def test_every_sample_has_an_attachment_of_33_bytes(way: NativeWay, app: ZenohApp) -> None:
    odom = way.publisher("odom", ros2_names.ODOMETRY, Qos())
    joints = way.publisher("joint_states", ros2_names.JOINT_STATE, Qos())
    heard = (
        app.collect(key("odom", ros2_names.ODOMETRY)),
        app.collect(key("joint_states", ros2_names.JOINT_STATE)),
    )
    await eventually(lambda: odom.has_subscribers and joints.has_subscribers)
    for payload in (b"one", b"two", b"three"):
        odom.put(payload)
    joints.put(b"joints")
    await eventually(lambda: len(heard[0]) == 3 and heard[1])
    attached = [sample.attachment.to_bytes() for samples in heard for sample in samples]
    assert [len(each) for each in attached] == [33] * 4
    parsed = [ros2_names.parse_attachment(each) for each in attached]
    assert [each.sequence for each in parsed] == [1, 2, 3, 1]
    assert {each.stamp_ns for each in parsed} == {WALL_NS}
    assert {each[16] for each in attached} == {16}
    gids = [each.gid for each in parsed]
    assert gids[0] == gids[1] == gids[2] != gids[3]


async def test_who_comes_late_is_given_what_is_latched_with_its_attachment(
    way: NativeWay, app: ZenohApp
) -> None:
    outlet = way.publisher("tf_static", ros2_names.TF_MESSAGE, Qos(latched=True, depth=1))
    outlet.put(b"frames")
    with late_subscriber(app.session, key("tf_static", ros2_names.TF_MESSAGE), newest=1) as heard:
        (sample,) = await eventually(lambda: heard)
        assert sample.payload.to_bytes() == b"frames"
        assert ros2_names.parse_attachment(sample.attachment.to_bytes()) is not None


async def test_both_kinds_of_commands_are_heard_and_one_is_announced(
    way: NativeWay, app: ZenohApp
) -> None:
    arrived: list[Arrival] = []
    way.subscriber(
        "cmd_vel", ros2_names.TWIST, Qos(depth=1), arrived.extend, also=ros2_names.TWIST_STAMPED
    )
    gid = bytes(range(16))
    for ros_type in (ros2_names.TWIST, ros2_names.TWIST_STAMPED):
        await app.reach(key("cmd_vel", ros_type))
        app.session.put(
            key("cmd_vel", ros_type),
            b"\0command",
            attachment=ros2_names.attachment(9, WALL_NS, gid),
        )
    await eventually(lambda: len(arrived) == 2)
    assert {ros2_names.parse_attachment(each.attachment or b"") for each in arrived} == {
        ros2_names.Attachment(9, WALL_NS, gid)
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

    way.service("yahboomd/odometry/reset", ros2_names.TRIGGER, offer)
    service = key("yahboomd/odometry/reset", ros2_names.TRIGGER)
    gid = bytes(range(16))
    (reply,) = await app.ask(
        service,
        payload=ros2_encoders.trigger_request(),
        attachment=ros2_names.attachment(42, 1, gid),
    )
    assert reply.ok.payload.to_bytes() == cdr.service_response(True, "done")
    assert reply.ok.attachment.to_bytes() == ros2_names.attachment(42, WALL_NS, gid)
    # One without attachment, or a strange one, is no client of rmw_zenoh's, and is answered too.
    for attachment in (None, b"x" * 33, b"x" * 5000):
        (reply,) = await app.ask(service, attachment=attachment)
        assert len(reply.ok.attachment.to_bytes()) == ros2_names.ATTACHMENT_BYTES
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
    assert [ros2_names.parse_attachment(each).sequence for each in publisher.attachments] == [
        1,
        2,
        3,
    ]
