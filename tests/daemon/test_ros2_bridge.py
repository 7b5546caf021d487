"""What a bridge sees of us on a real session."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import zenoh
import zenoh.ext
from zenoh_fixtures import ZenohApp, eventually

from yahboomd.bus.options import BusOptions
from yahboomd.bus.session import Bus
from yahboomd.daemon.ros2_bridge import BridgeWay
from yahboomd.messages import ros2
from yahboomd.messages.ros2 import Qos

pytestmark = pytest.mark.realtime

LATCHED = Qos(latched=True, depth=1)


def tokens(app: ZenohApp) -> set[str]:
    """What a bridge asks for when it joins."""
    replies = app.session.liveliness().get("@/*/@ros2_lv/**")
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
