"""A real node that speaks rmw_zenoh's protocol, beside us on one router, without any bridge.

What is read here are bytes: one node does. That nodes meet is seen in test_native_pairs.py.
"""

import threading
import time

import pytest
import zenoh

from yahboomd.core.messages import cdr
from yahboomd.ros2.messages import ros2_encoders, ros2_names

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]

DISTRO = "jazzy"
BEST_EFFORT = ros2_names.Qos(reliable=False, depth=5)


class Us:
    """The node /yahboomd, as rmw_zenoh's nodes see one: tokens, typed keys, attachments."""

    def __init__(self, session):
        self.session = session
        self.node = ros2_names.Node(domain_id=0, zid=str(session.info.zid()))
        self.tokens = [session.liveliness().declare_token(ros2_names.node_token(self.node))]
        self.sequence = 0

    def key(self, topic, ros_type):
        return ros2_names.native_key(self.node, topic=topic, ros_type=ros_type, distro=DISTRO)

    def announce(self, kind, topic, ros_type, qos):
        """Put an endpoint into the graph; its gid."""
        token = ros2_names.endpoint_token(
            kind,
            self.node,
            entity=len(self.tokens),
            topic=topic,
            ros_type=ros_type,
            qos=qos,
            distro=DISTRO,
        )
        self.tokens.append(self.session.liveliness().declare_token(token))
        return ros2_names.gid_of(token)

    def publisher(self, topic, message):
        """A function that publishes the message on the topic."""
        name = topic.removeprefix("/")
        gid = self.announce("MP", name, message.ros_type, ros2_names.Qos(latched=message.latched))
        key = self.key(name, message.ros_type)
        if message.latched:
            declared = zenoh.ext.declare_advanced_publisher(
                self.session,
                key,
                cache=zenoh.ext.CacheConfig(max_samples=1),
                publisher_detection=True,
            )
        else:
            declared = self.session.declare_publisher(key)

        def publish(payload=message.payload):
            self.sequence += 1
            attached = ros2_names.attachment(self.sequence, time.time_ns(), gid)
            declared.put(payload, attachment=attached)

        return publish

    def commands(self, got):
        self.announce("MS", "cmd_vel", ros2_names.TWIST, BEST_EFFORT)
        return self.session.declare_subscriber(self.key("cmd_vel", ros2_names.TWIST), got.append)


@pytest.fixture(params=["client", "router"])
def us(request, router, join):
    """We are a client of the graph's router, or a router that connects to it."""
    with join(router.endpoint, request.param) as session:
        yield Us(session)


def test_every_message_is_read_as_we_wrote_it(us, native_node, spoken):
    publish = {topic: us.publisher(topic, message) for topic, message in spoken.items()}
    enough = threading.Event()

    def keep_publishing():
        while not enough.wait(0.05):  # a node that has just started does not hear yet
            for say in publish.values():
                say()

    thread = threading.Thread(target=keep_publishing)
    thread.start()
    try:
        for topic, message in spoken.items():
            read = native_node.message(topic)
            assert {name: read[name] for name in message.read} == message.read
    finally:
        enough.set()
        thread.join()


def test_the_attachment_of_every_sample_is_read(us, native_node, eventually, spoken):
    gid = us.announce("MP", "odom", ros2_names.ODOMETRY, ros2_names.Qos())
    key = us.key("odom", ros2_names.ODOMETRY)
    attached = ros2_names.attachment(7, 1_700_000_000_123_456_789, gid)
    declared = us.session.declare_publisher(key)

    def heard():
        declared.put(spoken["/odom"].payload, attachment=attached)
        return [e for e in native_node.events if e.get("topic") == "/odom"]

    assert eventually(heard, "a sample")[0]["attachment"] == {
        "sequence": 7,
        "stamp_ns": 1_700_000_000_123_456_789,
        "gid": list(gid),
        "bytes": 33,
    }


def test_commands_arrive_with_their_attachment(us, native_node, eventually):
    got = []
    with us.commands(got):
        native_node.order("drive", vx=0.25, vy=-0.125, wz=-0.5, hz=50)
        eventually(lambda: len(got) > 2, "commands")
    velocity = cdr.decode_velocity(got[0].payload.to_bytes())
    assert (velocity.vx, velocity.vy, velocity.wz) == (0.25, -0.125, -0.5)
    first, second = (ros2_names.parse_attachment(s.attachment.to_bytes()) for s in got[:2])
    assert second.sequence == first.sequence + 1
    assert second.gid == first.gid
    assert abs(time.time_ns() - first.stamp_ns) < 60_000_000_000


def test_two_nodes_get_every_sample(us, start_native_node, spoken):
    nodes = [start_native_node(), start_native_node()]
    odometry = ros2_encoders.odometry("odom", "base_link")
    publish = us.publisher("/odom", spoken["/odom"])
    numbers, no_covariance = [0.0] * 6, [0.0] * 36

    def put(count):
        publish(odometry(count, [*numbers, 1.0], no_covariance, numbers, no_covariance))

    def count_of(node):
        return node.message("/odom")["header"]["stamp"]["nanosec"]

    count = 0
    deaf = list(nodes)
    while deaf:  # until each has heard us once
        count += 1
        put(count)
        time.sleep(0.02)
        deaf = [n for n in deaf if not any(e.get("topic") == "/odom" for e in n.events)]
    last = count + 300
    for number in range(count + 1, last + 1):
        put(number)
        time.sleep(0.001)
    for node in nodes:
        heard = [count_of(node)]
        while heard[-1] < last:
            heard.append(count_of(node))
        assert heard == list(range(heard[0], last + 1))
