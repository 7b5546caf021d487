"""Publishers of another type on a command's topic are named, with what helps."""

from __future__ import annotations

import json

import pytest
import zenoh
from zenoh_fixtures import ZenohApp, eventually

from yahboomd.core.bus.bus import Bus
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.messages.ros2_names import Node, Qos
from yahboomd.ros2.ros2_types import TypeWatch

pytestmark = pytest.mark.realtime

S = 1_000_000_000


class Watched:
    """A watch that is asked once in each five seconds of its own."""

    def __init__(self, watch: TypeWatch) -> None:
        self.watch = watch
        self.now_ns = 0

    def warnings(self) -> dict[str, str]:
        self.now_ns += 5 * S
        return self.watch.warnings(self.now_ns)


@pytest.fixture
def watch(bus: Bus) -> TypeWatch:
    return TypeWatch(bus, lambda _part, callback: callback)


def writers(app: ZenohApp, topic: str, *answers: bytes) -> zenoh.Queryable[None]:
    """A bridge's admin space with DDS writers."""

    def answer(query: zenoh.Query) -> None:
        for number, payload in enumerate(answers):
            query.reply(f"@/aa/ros2/dds/p/writer/{number}/rt/{topic}", payload)

    return app.session.declare_queryable("@/aa/ros2/**", answer)


def writer(ros_type: str) -> bytes:
    return json.dumps(
        {"key": "7", "type_name": ros2_names.dds_type(ros_type), "keyless": True}
    ).encode()


@pytest.mark.parametrize("topic", ["cmd_vel", "bot1/cmd_vel"])
async def test_a_writer_of_another_type_behind_a_bridge_is_named(
    watch: TypeWatch, app: ZenohApp, topic: str
) -> None:
    watch.watch_bridges("cmd_vel", ros2_names.TWIST)
    watched = Watched(watch)
    assert watched.warnings() == {}
    nested = b'{"key":' + b"[" * 3000
    broken = (b"{}", b"no JSON", nested, b'{"type_name": "\\ud800"}', b"\xff")
    both = writers(app, topic, *broken, writer(ros2_names.TWIST), writer(ros2_names.TWIST_STAMPED))
    words = (await eventually(watched.warnings))["cmd_vel"]
    assert "publishes geometry_msgs/msg/TwistStamped on bot1/cmd_vel" in words
    assert "expects geometry_msgs/msg/Twist:" in words
    assert 'Add "cmd_vel" to ros2.stamped_commands' in words
    both.undeclare()
    await eventually(lambda: not watched.warnings())


async def test_a_writer_of_the_expected_type_is_no_news(watch: TypeWatch, app: ZenohApp) -> None:
    watch.watch_bridges("cmd_vel", ros2_names.TWIST_STAMPED)
    watched = Watched(watch)
    right = writers(app, "cmd_vel", writer(ros2_names.TWIST_STAMPED))
    assert not any(watched.warnings() for _ in range(5))
    right.undeclare()
    _wrong = writers(app, "cmd_vel", writer(ros2_names.TWIST))
    assert 'Take "cmd_vel" out of' in (await eventually(watched.warnings))["cmd_vel"]


async def test_natively_both_types_of_commands_are_right_and_others_are_named(
    watch: TypeWatch, app: ZenohApp
) -> None:
    watch.watch_nodes("cmd_vel", ros2_names.TWIST, 7)
    node = Node(domain_id=7, zid="aa", name="nav", namespace="bot1")
    tokens = {}
    for entity, ros_type in enumerate(
        (ros2_names.TWIST_STAMPED, ros2_names.TWIST, ros2_names.BOOL), start=1
    ):
        token = ros2_names.endpoint_token(
            "MP",
            node,
            entity=entity,
            topic="bot1/cmd_vel",
            ros_type=ros_type,
            qos=Qos(),
            distro="jazzy",
        )
        tokens[ros_type] = app.session.liveliness().declare_token(token)
    watched = Watched(watch)
    words = (await eventually(watched.warnings))["cmd_vel"]
    assert "publishes std_msgs/msg/Bool on bot1/cmd_vel" in words
    assert "Twist" not in words.partition(" on ")[0]
    tokens[ros2_names.BOOL].undeclare()
    await eventually(lambda: not watched.warnings())


@pytest.mark.parametrize("topic", ["odom", "joint_states"])
async def test_another_publisher_of_a_topic_of_ours_is_named(
    watch: TypeWatch, bus: Bus, app: ZenohApp, topic: str
) -> None:
    watch.watch_bridges(topic, "")
    watch.watch_nodes(topic, "", 7)
    watched = Watched(watch)

    def token(zid: str) -> str:
        node = Node(domain_id=7, zid=zid, name="other", namespace="bot1")
        kind = {"entity": 1, "topic": f"bot1/{topic}", "ros_type": ros2_names.TWIST_STAMPED}
        return ros2_names.endpoint_token("MP", node, qos=Qos(), distro="jazzy", **kind)  # type: ignore[arg-type]

    bus.token(f"/{token(bus.zid)}")
    assert not any(watched.warnings() for _ in range(5))
    foreign = writers(app, f"bot1/{topic}", writer("nav_msgs/msg/Odometry"))
    words = (await eventually(watched.warnings))[topic]
    assert f"Another program publishes bot1/{topic}, which is yahboomd's: a second robot" in words
    foreign.undeclare()
    await eventually(lambda: not watched.warnings())
    _token = app.session.liveliness().declare_token(token("aa").replace("TwistStamped_", "Bool_"))
    assert topic in await eventually(watched.warnings)
