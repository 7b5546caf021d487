"""The real zenoh-bridge-ros2dds, with the example's configuration, between us and a DDS node."""

import threading

import pytest
import zenoh

from yahboomd.core.messages import cdr
from yahboomd.ros2.messages import ros2_names

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]

TRIGGERS = ("yahboomd/estop/reset", "yahboomd/odometry/reset")


def plain(topic):
    return topic.removeprefix("/")


def publisher(session, topic, message):
    """As yahboomd publishes on a topic: plain key, latched ones with a cache."""
    if not message.latched:
        return session.declare_publisher(plain(topic))
    return zenoh.ext.declare_advanced_publisher(
        session,
        plain(topic),
        cache=zenoh.ext.CacheConfig(max_samples=1),
        publisher_detection=True,
    )


def tokens(session, spoken):
    """As yahboomd announces itself to bridges; and a key that the example does not let pass."""
    zid = str(session.info.zid())
    best_effort = ros2_names.Qos(reliable=False, depth=1)
    announced = [
        ("MP", plain(topic), message.ros_type, ros2_names.Qos(latched=message.latched))
        for topic, message in spoken.items()
    ]
    announced += [
        ("MP", "pose", ros2_names.ODOMETRY, ros2_names.Qos()),
        ("MS", "cmd_vel", ros2_names.TWIST, best_effort),
        ("SS", "yahboomd/estop", ros2_names.SET_BOOL, best_effort),
        *(("SS", key, ros2_names.TRIGGER, best_effort) for key in TRIGGERS),
    ]
    return [
        session.liveliness().declare_token(
            ros2_names.bridge_token(
                kind, zid=zid, key=key, ros_type=kind_of, qos=qos, distro="jazzy"
            )
        )
        for kind, key, kind_of, qos in announced
    ]


def serve(session, asked, said="as you wish"):
    """Answers the three services, and notes the requests."""

    def answer(query):
        asked.append((str(query.key_expr), query.payload.to_bytes()))
        query.reply(str(query.key_expr), cdr.service_response(True, said))

    return [session.declare_queryable(key, answer) for key in ("yahboomd/estop", *TRIGGERS)]


def test_every_message_is_read_in_ros_as_we_wrote_it(bridge, dds_node, join, spoken):
    with join(bridge.endpoint) as session:
        publishers = {topic: publisher(session, topic, spoken[topic]) for topic in spoken}
        enough = threading.Event()

        def publish():
            while not enough.wait(0.05):  # a route opens a moment after its publisher
                for topic, message in spoken.items():
                    publishers[topic].put(message.payload)

        thread = threading.Thread(target=publish)
        thread.start()
        try:
            for topic, message in spoken.items():
                read = dds_node.message(topic)
                assert {name: read[name] for name in message.read} == message.read
        finally:
            enough.set()
            thread.join()


@pytest.mark.parametrize(("stamped", "size"), [(False, 52), (True, 76)])
def test_commands_of_a_ros_node_arrive(bridge, dds_node, join, eventually, stamped, size):
    with join(bridge.endpoint) as session:
        got = []
        with session.declare_subscriber("cmd_vel", lambda s: got.append(s.payload.to_bytes())):
            dds_node.order("drive", vx=0.25, vy=-0.125, wz=-0.5, hz=50, stamped=stamped)
            eventually(lambda: got, "a command")
        velocity = cdr.decode_velocity(got[0])
        assert (velocity.vx, velocity.vy, velocity.wz) == (0.25, -0.125, -0.5)
        assert (velocity.stamp_ns is not None) == stamped
        assert len(got[0]) == size


def test_what_we_announce_shows_before_anybody_uses_it(
    bridge, start_dds_node, join, eventually, spoken
):
    onlooker = start_dds_node("-")
    with join(bridge.endpoint) as session:
        assert not {t for t in onlooker.graph()["publishers"] if t.startswith("rt/")}
        _announced = tokens(session, spoken)
        _subscriber = session.declare_subscriber("cmd_vel", lambda _: None)
        _services = serve(session, [])
        wanted = {"rt/cmd_vel", "rq/yahboomd/estopRequest", *(f"rq/{k}Request" for k in TRIGGERS)}
        eventually(lambda: wanted <= onlooker.graph()["subscribers"].keys(), "what we listen to")
        types = {
            f"rt{topic}": ros2_names.dds_type(message.ros_type) for topic, message in spoken.items()
        }
        eventually(lambda: types.keys() <= onlooker.graph()["publishers"].keys(), "what we publish")
        graph = onlooker.graph()
        shown = {topic: kind for topic, kind in graph["publishers"].items() if topic[:3] == "rt/"}
        assert shown == types  # and no /pose: the list of the example lets it not pass
        assert graph["subscribers"]["rt/cmd_vel"] == ros2_names.dds_type(ros2_names.TWIST)
    eventually(lambda: "rt/odom" not in onlooker.graph()["publishers"], "our leaving")


def test_the_examples_list_keeps_all_other_encodings_off_ros_topics(
    bridge, start_dds_node, join, eventually, spoken
):
    native = ("yahboomd/pose", "yahboomd/status", "odometry")
    with join(bridge.endpoint) as session:
        publishers = {key: session.declare_publisher(key) for key in (*native, "odom")}
        # The last one is routed: by then the others, which came first, would have been.
        node = start_dds_node(*(f"/{key}" for key in native), "/odom")

        def heard():
            for key in native:
                publishers[key].put(b'{"stamp_ns": 1}')
            publishers["odom"].put(spoken["/odom"].payload)
            return [event for event in node.events if event.get("topic") == "/odom"]

        for _ in range(3):
            eventually(heard, "odometry")
            node.events.clear()
        assert [key for key in native if publishers[key].matching_status.matching] == []
        assert publishers["odom"].matching_status.matching


def test_a_node_that_starts_late_gets_the_static_frames(bridge, start_dds_node, join, spoken):
    with join(bridge.endpoint) as session:
        message = spoken["/tf_static"]
        _frames = publisher(session, "/tf_static", message)
        _frames.put(message.payload)
        for _ in range(2):
            assert start_dds_node("/tf_static").message("/tf_static") == message.read


def test_services_are_asked_and_answered(bridge, dds_node, join):
    asked = []
    with join(bridge.endpoint) as session:
        _services = serve(session, asked)
        done = {"success": True, "message": "as you wish"}
        assert dds_node.call("/yahboomd/estop", data=True)["reply"] == done
        assert dds_node.call("/yahboomd/estop", data=False)["reply"] == done
        for key in TRIGGERS:
            assert dds_node.call(f"/{key}")["reply"] == done
    assert [key for key, _ in asked] == ["yahboomd/estop", "yahboomd/estop", *TRIGGERS]
    assert [cdr.decode_bool(payload) for _, payload in asked[:2]] == [True, False]
    assert all(cdr.is_cdr(payload) for _, payload in asked)


@pytest.fixture
def live_once(bridge, dds_node, join, eventually, spoken):
    """One life of our session: everything announced, heard, answered; then it goes."""

    def live(name):
        with join(bridge.endpoint) as session:
            got = []
            _announced = tokens(session, spoken)
            _frames = publisher(session, "/tf_static", spoken["/tf_static"])
            _frames.put(spoken["/tf_static"].payload)
            _commands = session.declare_subscriber("cmd_vel", got.append)
            _services = serve(session, [], name)
            assert dds_node.message("/tf_static") == spoken["/tf_static"].read
            dds_node.order("drive", vx=0.1, hz=50)
            eventually(lambda: got, f"a command in the {name} life")
            assert dds_node.call("/yahboomd/estop", data=True)["reply"]["message"] == name

    return live


def test_a_new_session_takes_over_from_the_last(live_once):
    live_once("first")
    live_once("second")


def test_a_restarted_bridge_finds_everything_again(bridge, dds_node, join, eventually, spoken):
    with join(bridge.endpoint) as session:
        got = []
        _announced = tokens(session, spoken)
        _frames = publisher(session, "/tf_static", spoken["/tf_static"])
        _frames.put(spoken["/tf_static"].payload)
        _commands = session.declare_subscriber("cmd_vel", got.append)
        _services = serve(session, [])
        assert dds_node.message("/tf_static") == spoken["/tf_static"].read
        dds_node.order("drive", vx=0.1, hz=50)
        eventually(lambda: got, "a command")
        bridge.stop()
        got.clear()
        bridge.start()
        assert dds_node.message("/tf_static") == spoken["/tf_static"].read
        eventually(lambda: got, "a command after the restart")
        assert dds_node.call("/yahboomd/estop", data=True)["event"] == "reply"
