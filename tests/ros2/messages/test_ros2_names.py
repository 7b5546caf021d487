"""Names and bytes that ROS 2 peers parse: exact, character by character."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.ros2.messages import ros2_names

ODOMETRY_HASH = "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"
TWIST_HASH = "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a"
ZID = "aa3702ee9ab5cd68f20a2b1c3d4e5f60"
NODE = ros2_names.Node(domain_id=0, zid=ZID)


@pytest.mark.parametrize("ros_type", ros2_names.TYPE_HASHES)
def test_type_hashes_equal_those_computed_from_the_definitions(oracle, ros_type):
    assert ros2_names.TYPE_HASHES[ros_type] == oracle.type_hash(ros_type)
    assert ros2_names.type_hash(ros_type, "jazzy") == oracle.type_hash(ros_type)


def test_humble_knows_no_type_hashes():
    assert ros2_names.type_hash(ros2_names.ODOMETRY, "humble") == "TypeHashNotSupported"


def test_dds_types_are_named_as_dds_does():
    assert ros2_names.dds_type("nav_msgs/msg/Odometry") == "nav_msgs::msg::dds_::Odometry_"
    assert ros2_names.dds_type("std_srvs/srv/Trigger") == "std_srvs::srv::dds_::Trigger_"


# --- the bridge -----------------------------------------------------------------------------


def test_the_bridge_sees_a_publisher():
    token = ros2_names.bridge_token(
        "MP",
        zid=ZID,
        key="odom",
        ros_type=ros2_names.ODOMETRY,
        qos=ros2_names.Qos(depth=10),
        distro="jazzy",
    )
    assert token == (
        f"@/{ZID}/@ros2_lv/MP/odom/nav_msgs§msg§Odometry/:1:0:0,10:typehash={ODOMETRY_HASH};"
    )


def test_the_bridge_sees_a_best_effort_subscriber_under_a_namespace():
    token = ros2_names.bridge_token(
        "MS",
        zid=ZID,
        key="bot1/cmd_vel",
        ros_type=ros2_names.TWIST,
        qos=ros2_names.Qos(reliable=False, depth=1),
        distro="jazzy",
    )
    assert token == (
        f"@/{ZID}/@ros2_lv/MS/bot1§cmd_vel/geometry_msgs§msg§Twist/:0:0:0,1:typehash={TWIST_HASH};"
    )


def test_the_bridge_sees_a_latched_publisher_and_humble_gets_no_hash():
    token = ros2_names.bridge_token(
        "MP",
        zid=ZID,
        key="tf_static",
        ros_type=ros2_names.TF_MESSAGE,
        qos=ros2_names.Qos(latched=True, depth=1),
        distro="humble",
    )
    assert token == f"@/{ZID}/@ros2_lv/MP/tf_static/tf2_msgs§msg§TFMessage/:1:1:0,1"


def test_the_bridge_sees_a_service():
    token = ros2_names.bridge_token(
        "SS",
        zid=ZID,
        key="yahboomd/odometry/reset",
        ros_type=ros2_names.TRIGGER,
        qos=ros2_names.Qos(),
        distro="jazzy",
    )
    assert token == f"@/{ZID}/@ros2_lv/SS/yahboomd§odometry§reset/std_srvs§srv§Trigger"


# --- native ---------------------------------------------------------------------------------


def test_native_keys_carry_domain_type_and_hash():
    key = ros2_names.native_key(NODE, topic="odom", ros_type=ros2_names.ODOMETRY, distro="jazzy")
    assert key == f"0/odom/nav_msgs::msg::dds_::Odometry_/{ODOMETRY_HASH}"
    other = ros2_names.Node(domain_id=42, zid=ZID)
    key = ros2_names.native_key(
        other, topic="bot1/cmd_vel", ros_type=ros2_names.TWIST, distro="humble"
    )
    assert key == "42/bot1/cmd_vel/geometry_msgs::msg::dds_::Twist_/TypeHashNotSupported"


def test_the_node_shows_in_the_graph():
    assert ros2_names.node_token(NODE) == f"@ros2_lv/0/{ZID}/0/0/NN/%/%/yahboomd"
    named = ros2_names.Node(domain_id=7, zid=ZID, name="base", namespace="fleet/bot1")
    assert ros2_names.node_token(named) == f"@ros2_lv/7/{ZID}/0/0/NN/%/%fleet%bot1/base"


@pytest.mark.parametrize(
    ("kind", "topic", "ros_type", "qos", "tail"),
    [
        (
            "MP",
            "odom",
            ros2_names.ODOMETRY,
            ros2_names.Qos(),
            f"%odom/nav_msgs::msg::dds_::Odometry_/{ODOMETRY_HASH}/::,10:,:,:,,",
        ),
        (
            "MS",
            "bot1/cmd_vel",
            ros2_names.TWIST,
            ros2_names.Qos(reliable=False, depth=5),
            f"%bot1%cmd_vel/geometry_msgs::msg::dds_::Twist_/{TWIST_HASH}/2::,5:,:,:,,",
        ),
        (
            "MP",
            "odom",
            ros2_names.ODOMETRY,
            ros2_names.Qos(latched=True, depth=1),
            f"%odom/nav_msgs::msg::dds_::Odometry_/{ODOMETRY_HASH}/:1:,1:,:,:,,",
        ),
        (
            "MP",
            "odom",
            ros2_names.ODOMETRY,
            ros2_names.Qos(depth=42),
            f"%odom/nav_msgs::msg::dds_::Odometry_/{ODOMETRY_HASH}/::,:,:,:,,",
        ),
    ],
)
def test_endpoints_show_in_the_graph(kind, topic, ros_type, qos, tail):
    token = ros2_names.endpoint_token(
        kind, NODE, entity=11, topic=topic, ros_type=ros_type, qos=qos, distro="jazzy"
    )
    assert token == f"@ros2_lv/0/{ZID}/0/11/{kind}/%/%/yahboomd/{tail}"


def test_a_service_shows_in_the_graph():
    token = ros2_names.endpoint_token(
        "SS",
        ros2_names.Node(domain_id=0, zid=ZID, namespace="bot1"),
        entity=12,
        topic="bot1/estop",
        ros_type=ros2_names.SET_BOOL,
        qos=ros2_names.Qos(),
        distro="jazzy",
    )
    assert token == (
        f"@ros2_lv/0/{ZID}/0/12/SS/%/%bot1/yahboomd/%bot1%estop/std_srvs::srv::dds_::SetBool_/"
        f"{ros2_names.TYPE_HASHES[ros2_names.SET_BOOL]}/::,10:,:,:,,"
    )


names = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*){0,2}", fullmatch=True)


@given(
    st.sampled_from(["MP", "MS", "SS"]),
    st.sampled_from(list(ros2_names.TYPE_HASHES)),
    st.sampled_from(["humble", "iron", "jazzy", "kilted", "lyrical", "rolling"]),
    st.integers(0, 232),
    st.just("") | names,
    names,
    st.builds(
        ros2_names.Qos, reliable=st.booleans(), latched=st.booleans(), depth=st.integers(1, 1000)
    ),
)
def test_whatever_the_names_every_part_of_a_token_and_a_key_is_in_its_place(
    kind, ros_type, distro, domain_id, namespace, topic, qos
):
    node = ros2_names.Node(domain_id=domain_id, zid=ZID, namespace=namespace)
    full = f"{namespace}/{topic}" if namespace else topic
    of = {"topic": full, "ros_type": ros_type, "distro": distro}
    token = ros2_names.endpoint_token(kind, node, entity=3, qos=qos, **of)
    parts = token.split("/")
    assert len(parts) == 13
    assert parts[:6] == ["@ros2_lv", str(domain_id), ZID, "0", "3", kind]
    assert [parts[7].replace("%", "/"), parts[9].replace("%", "/")] == [f"/{namespace}", f"/{full}"]
    assert parts[10:12] == [ros2_names.dds_type(ros_type), ros2_names.type_hash(ros_type, distro)]
    assert ros2_names.node_token(node).split("/") == [*parts[:4], "0", "NN", *parts[6:9]]
    key = ros2_names.native_key(node, **of)
    assert key.split("/")[-2:] == parts[10:12]
    assert key == f"{domain_id}/{full}/{parts[10]}/{parts[11]}"
    assert len(ros2_names.attachment(1, 1, ros2_names.gid_of(token))) == 33
    bridge = ros2_names.bridge_token(
        kind, zid=ZID, key=full, ros_type=ros_type, qos=qos, distro=distro
    )
    chunks = bridge.split("/")
    assert len(chunks) == (6 if kind == "SS" else 7)
    assert chunks[4].replace("§", "/") == full
    assert not set(token + key + bridge[2:]) & set("*$?# ")


# --- the attachment -------------------------------------------------------------------------


def test_the_attachment_has_these_33_bytes():
    data = ros2_names.attachment(1, 1_700_000_000_123_456_789, bytes(range(16)))
    assert data.hex() == (
        "0100000000000000"  # sequence
        "15cd853dfe9c9717"  # Unix ns
        "10"  # length of the gid
        "000102030405060708090a0b0c0d0e0f"
    )


@given(
    st.integers(-(2**63), 2**63 - 1), st.integers(0, 2**63 - 1), st.binary(min_size=16, max_size=16)
)
def test_an_attachment_survives_the_round_trip(sequence, stamp_ns, gid):
    data = ros2_names.attachment(sequence, stamp_ns, gid)
    assert len(data) == ros2_names.ATTACHMENT_BYTES == 33
    assert ros2_names.parse_attachment(data) == (sequence, stamp_ns, gid)


@given(st.binary(max_size=40))
def test_what_is_no_attachment_is_none(data):
    parsed = ros2_names.parse_attachment(data)
    assert (parsed is not None) == (len(data) == 33 and data[16] == 16)


def test_an_attachment_with_another_length_of_gid_is_none():
    data = struct.pack("<qqB16s", 1, 2, 15, bytes(16))
    assert ros2_names.parse_attachment(data) is None


@pytest.mark.parametrize("size", [0, 15, 17])
def test_a_gid_of_another_length_is_never_sent(size):
    with pytest.raises(ValueError, match="16 bytes"):
        ros2_names.attachment(1, 2, bytes(size))


def test_endpoints_have_gids_of_their_own():
    gids = {ros2_names.gid_of(f"token{i}") for i in range(100)}
    assert len(gids) == 100
    assert {len(gid) for gid in gids} == {16}
    assert ros2_names.gid_of("token1") == ros2_names.gid_of("token1")
