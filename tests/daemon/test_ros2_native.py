"""What an rmw_zenoh graph sees of us on a real session."""

from __future__ import annotations

import pytest
import zenoh.ext
from zenoh_fixtures import ZenohApp, eventually

from yahboomd.bus.session import Bus
from yahboomd.bus.subscriptions import Arrival
from yahboomd.daemon.ros2_native import AttachedOutlet, NativeWay
from yahboomd.messages import cdr, ros2
from yahboomd.messages.native import ServiceReply
from yahboomd.messages.ros2 import Qos

pytestmark = pytest.mark.realtime

WALL_NS = 1_700_000_000_123_456_789
DISTRO = "jazzy"


@pytest.fixture
def way(bus: Bus) -> NativeWay:
    return NativeWay(bus, domain_id=7, distro=DISTRO, wall_ns=lambda: WALL_NS)


def key(topic: str, ros_type: str) -> str:
    return f"7/bot1/{topic}/{ros2.dds_type(ros_type)}/{ros2.TYPE_HASHES[ros_type]}"


def tokens(app: ZenohApp) -> set[str]:
    """What a node asks for when it joins the graph of its domain."""
    replies = app.session.liveliness().get("@ros2_lv/7/**")
    return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}


async def test_the_node_shows_with_all_that_it_has(bus: Bus, way: NativeWay, app: ZenohApp) -> None:
    way.publisher("odom", ros2.ODOMETRY, Qos())
    way.subscriber("cmd_vel", ros2.TWIST, Qos(reliable=False, depth=1), lambda _: None)
    way.service("yahboomd/estop", ros2.SET_BOOL, lambda at, answer: None)
    await eventually(lambda: len(tokens(app)) == 4)
    ours, hashes = f"@ros2_lv/7/{bus.zid}/0", ros2.TYPE_HASHES
    odom = f"%bot1%odom/nav_msgs::msg::dds_::Odometry_/{hashes[ros2.ODOMETRY]}"
    commands = f"%bot1%cmd_vel/geometry_msgs::msg::dds_::Twist_/{hashes[ros2.TWIST]}"
    estop = f"%bot1%yahboomd%estop/std_srvs::srv::dds_::SetBool_/{hashes[ros2.SET_BOOL]}"
    assert tokens(app) == {
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
    announced = "".join(tokens(app))
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
