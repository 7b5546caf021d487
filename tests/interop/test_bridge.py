"""The real zenoh-bridge-ros2dds, with the example's configuration, between us and a DDS node."""

import threading

import pytest
import zenoh

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]


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
