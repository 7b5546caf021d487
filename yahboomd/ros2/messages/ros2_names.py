"""The names of ROS 2 on Zenoh: keys, liveliness tokens, attachments and type hashes.

Two ways lead into a ROS 2 graph, and each has names of its own:

- *The bridge* (zenoh-bridge-ros2dds): plain keys, and tokens below ``@/<zid>/@ros2_lv`` that make
  a topic show before anyone uses it.
- *Native* (rmw_zenoh): keys that carry domain, type and hash, tokens below ``@ros2_lv``, and an
  attachment on every sample. A malformed attachment ends the receiving process, so its bytes are
  fixed here and tested.
"""

from __future__ import annotations

import hashlib
import struct
from typing import Literal, NamedTuple, TypeAlias

import msgspec

TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
JOINT_STATE = "sensor_msgs/msg/JointState"
IMU = "sensor_msgs/msg/Imu"
BATTERY_STATE = "sensor_msgs/msg/BatteryState"
DIAGNOSTIC_ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
BOOL = "std_msgs/msg/Bool"
LOG = "rcl_interfaces/msg/Log"
TRIGGER = "std_srvs/srv/Trigger"
SET_BOOL = "std_srvs/srv/SetBool"
LIST_PARAMETERS = "rcl_interfaces/srv/ListParameters"
DESCRIBE_PARAMETERS = "rcl_interfaces/srv/DescribeParameters"
GET_PARAMETERS = "rcl_interfaces/srv/GetParameters"
GET_PARAMETER_TYPES = "rcl_interfaces/srv/GetParameterTypes"
SET_PARAMETERS = "rcl_interfaces/srv/SetParameters"
SET_ATOMICALLY = "rcl_interfaces/srv/SetParametersAtomically"

TYPE_HASHES: dict[str, str] = {
    TWIST: "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    TWIST_STAMPED: "RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    ODOMETRY: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
    POSE: "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
    TF_MESSAGE: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    JOINT_STATE: "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    IMU: "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
    BATTERY_STATE: "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
    DIAGNOSTIC_ARRAY: "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    BOOL: "RIHS01_feb91e995ff9ebd09c0cb3d2aed18b11077585839fb5db80193b62d74528f6c9",
    LOG: "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
    TRIGGER: "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    SET_BOOL: "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
    LIST_PARAMETERS: "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
    DESCRIBE_PARAMETERS: "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
    GET_PARAMETERS: "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
    GET_PARAMETER_TYPES: "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
    SET_PARAMETERS: "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
    SET_ATOMICALLY: "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
}
"""RIHS01 (REP 2016) of every type in use, the same in all distributions that have hashes."""

NO_TYPE_HASH = "TypeHashNotSupported"
"""Written instead of the hash on Humble, which has no type hashes."""

DISTROS_WITHOUT_HASHES = frozenset({"humble"})

NODE = "yahboomd"
"""The name of our node."""

EndpointKind: TypeAlias = Literal["MP", "MS", "SS", "SC"]
"""Message publisher, message subscriber, service server, service client."""

GID_BYTES = 16
_ATTACHMENT = struct.Struct(f"<qqB{GID_BYTES}s")
ATTACHMENT_BYTES = _ATTACHMENT.size

_NATIVE_DEPTH = 42
"""rmw_zenoh's default depth, which its tokens leave out like every default."""


class Qos(msgspec.Struct, frozen=True, kw_only=True):
    """The part of a ROS 2 quality of service that matters here; history is keep-last.

    Attributes:
        reliable: Reliable, else best effort.
        latched: Transient local: late subscribers get the last samples, else volatile.
        depth: Samples kept.
    """

    reliable: bool = True
    latched: bool = False
    depth: int = 10


class Node(msgspec.Struct, frozen=True, kw_only=True):
    """A node of an rmw_zenoh graph.

    Attributes:
        domain_id: ``ROS_DOMAIN_ID``.
        zid: The session's Zenoh id as Zenoh prints it.
        namespace: The node's namespace without slashes at its ends; empty for none.
    """

    domain_id: int
    zid: str
    name: str = NODE
    namespace: str = ""


class Attachment(NamedTuple):
    """The attachment of rmw_zenoh to a sample, a request and a reply."""

    sequence: int
    stamp_ns: int
    gid: bytes


def type_hash(ros_type: str, distro: str) -> str:
    """The hash that names a type, in a distribution such as ``jazzy``."""
    return NO_TYPE_HASH if distro in DISTROS_WITHOUT_HASHES else TYPE_HASHES[ros_type]


def dds_type(ros_type: str) -> str:
    """A type's name on DDS: ``nav_msgs/msg/Odometry`` is ``nav_msgs::msg::dds_::Odometry_``."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


# --- the bridge -----------------------------------------------------------------------------


def bridge_token(
    kind: EndpointKind, *, zid: str, key: str, ros_type: str, qos: Qos, distro: str
) -> str:
    """The token that announces a topic or a service to every bridge.

    Args:
        key: The plain key, with namespaces, such as ``bot1/odom``.
        qos: Becomes that of the DDS writer or reader; services have none.
        distro: Decides whether there is a type hash.
    """
    name, type_name = key.replace("/", "§"), ros_type.replace("/", "§")
    token = f"@/{zid}/@ros2_lv/{kind}/{name}/{type_name}"
    if kind in {"SS", "SC"}:
        return token
    # keyless : reliability : durability : history, depth; DDS counts best effort, volatile and
    # keep-last as zero.
    token += f"/:{qos.reliable:d}:{qos.latched:d}:0,{qos.depth}"
    if distro not in DISTROS_WITHOUT_HASHES:
        token += f":typehash={type_hash(ros_type, distro)};"
    return token


def bridge_writers(topic: str) -> str:
    """Asks every bridge for the DDS writers of a topic, in its admin space.

    Args:
        topic: As ROS names it behind the bridge, without a slash in front.
    """
    return f"@/*/ros2/dds/*/writer/*/rt/{topic}"


def bridge_readers(topic: str) -> str:
    """Asks every bridge for the DDS readers of a topic, in its admin space."""
    return f"@/*/ros2/dds/*/reader/*/rt/{topic}"


BRIDGE_ROUTES = "@/*/ros2/route/topic/sub/**"
"""Asks every bridge for its routes from Zenoh to DDS, in its admin space."""


# --- native ---------------------------------------------------------------------------------


def native_key(node: Node, *, topic: str, ros_type: str, distro: str) -> str:
    """The key on which an rmw_zenoh graph carries a topic or a service.

    Args:
        node: Gives the domain; its namespace is not added to the topic.
        topic: Fully qualified, without slashes at its ends, such as ``bot1/odom``.
        distro: Decides the type hash.
    """
    return f"{node.domain_id}/{topic}/{dds_type(ros_type)}/{type_hash(ros_type, distro)}"


def node_token(node: Node) -> str:
    """The token that makes ``ros2 node list`` show the node; it is entity 0 of the session."""
    return (
        f"@ros2_lv/{node.domain_id}/{node.zid}/0/0/NN/%/{_mangle(node.namespace)}/"
        f"{_mangle_name(node.name)}"
    )


def endpoint_token(
    kind: EndpointKind,
    node: Node,
    *,
    entity: int,
    topic: str,
    ros_type: str,
    qos: Qos,
    distro: str,
) -> str:
    """The token that puts a publisher, a subscriber or a service into the graph.

    Args:
        entity: Its number, from 1 on, different from all others of the session.
        topic: Fully qualified, without slashes at its ends.
        qos: As the endpoint announces it.
        distro: Decides the type hash.
    """
    return (
        f"@ros2_lv/{node.domain_id}/{node.zid}/0/{entity}/{kind}/%/{_mangle(node.namespace)}/"
        f"{_mangle_name(node.name)}/{_mangle(topic)}/{dds_type(ros_type)}/"
        f"{type_hash(ros_type, distro)}/{_native_qos(qos)}"
    )


def publisher_tokens(domain_id: int, topic: str) -> str:
    """Matches the tokens of a topic's publishers.

    Args:
        topic: Fully qualified, without slashes at its ends.
    """
    return f"@ros2_lv/{domain_id}/*/*/*/MP/*/*/*/{_mangle(topic)}/*/*/*"


def type_of_token(token: str) -> str:
    """The type in an endpoint's token: ``nav_msgs/msg/Odometry``."""
    return ros_type_of(token.split("/")[10])


def ros_type_of(dds_name: str) -> str:
    """A type by its name on DDS; the opposite of :func:`dds_type`."""
    return dds_name.replace("::dds_::", "/").replace("::", "/").removesuffix("_")


def gid_of(token: str) -> bytes:
    """16 bytes that identify an endpoint: a digest of its token, which is unique."""
    return hashlib.blake2b(token.encode(), digest_size=GID_BYTES).digest()


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """The 33 bytes that rmw_zenoh requires with every sample.

    Args:
        sequence: Counts the samples of this publisher, from 1 on; a reply repeats the request's.
        stamp_ns: When it was published, Unix ns.
        gid: The publisher's, 16 bytes; a reply repeats the client's.

    Raises:
        ValueError: The gid has another length. ``struct`` would pad or cut it in silence, and a
            malformed attachment ends the receiving process.
    """
    if len(gid) != GID_BYTES:
        raise ValueError(f"a gid has {GID_BYTES} bytes, not {len(gid)}")
    return _ATTACHMENT.pack(sequence, stamp_ns, GID_BYTES, gid)


def parse_attachment(data: bytes) -> Attachment | None:
    """Reads the attachment of a request; none if it is not one."""
    if len(data) != ATTACHMENT_BYTES:
        return None
    sequence, stamp_ns, length, gid = _ATTACHMENT.unpack(data)
    return Attachment(sequence, stamp_ns, gid) if length == GID_BYTES else None


def _mangle(name: str) -> str:
    """A topic or namespace as one chunk of a key: absolute, with ``%`` for every slash."""
    return "%" + name.strip("/").replace("/", "%")


def _mangle_name(name: str) -> str:
    return name.replace("/", "%")


def _native_qos(qos: Qos) -> str:
    """Reliability, durability, history and depth, deadline, lifespan, liveliness.

    Defaults are left out; the numbers are rmw's: best effort 2, transient local 1.
    """
    reliability = "" if qos.reliable else "2"
    durability = "1" if qos.latched else ""
    depth = "" if qos.depth == _NATIVE_DEPTH else str(qos.depth)
    return f"{reliability}:{durability}:,{depth}:,:,:,,"
