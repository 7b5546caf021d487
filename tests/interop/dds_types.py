"""The ROS 2 messages of a robot base as DDS types, named as ROS 2 names them on the wire.

Written from the public message definitions, apart from yahboomd's own codecs, so that a test of one
is no test of itself. Field order is the wire order. Needs the package `cyclonedds`.
"""

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import (
    array,
    float32,
    float64,
    int32,
    int64,
    sequence,
    uint8,
    uint32,
    uint64,
)


def _dds(package: str, name: str, kind: str = "msg") -> str:
    return f"{package}::{kind}::dds_::{name}_"


@dataclass
class Time(IdlStruct, typename=_dds("builtin_interfaces", "Time")):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename=_dds("std_msgs", "Header")):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename=_dds("geometry_msgs", "Vector3")):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename=_dds("geometry_msgs", "Point")):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename=_dds("geometry_msgs", "Quaternion")):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename=_dds("geometry_msgs", "Pose")):
    position: Point
    orientation: Quaternion


@dataclass
class PoseWithCovariance(IdlStruct, typename=_dds("geometry_msgs", "PoseWithCovariance")):
    pose: Pose
    covariance: array[float64, 36]


@dataclass
class Twist(IdlStruct, typename=_dds("geometry_msgs", "Twist")):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistStamped(IdlStruct, typename=_dds("geometry_msgs", "TwistStamped")):
    header: Header
    twist: Twist


@dataclass
class TwistWithCovariance(IdlStruct, typename=_dds("geometry_msgs", "TwistWithCovariance")):
    twist: Twist
    covariance: array[float64, 36]


@dataclass
class Odometry(IdlStruct, typename=_dds("nav_msgs", "Odometry")):
    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


@dataclass
class Transform(IdlStruct, typename=_dds("geometry_msgs", "Transform")):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename=_dds("geometry_msgs", "TransformStamped")):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename=_dds("tf2_msgs", "TFMessage")):
    transforms: sequence[TransformStamped]


@dataclass
class JointState(IdlStruct, typename=_dds("sensor_msgs", "JointState")):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class BatteryState(IdlStruct, typename=_dds("sensor_msgs", "BatteryState")):
    header: Header
    voltage: float32
    temperature: float32
    current: float32
    charge: float32
    capacity: float32
    design_capacity: float32
    percentage: float32
    power_supply_status: uint8
    power_supply_health: uint8
    power_supply_technology: uint8
    present: bool
    cell_voltage: sequence[float32]
    cell_temperature: sequence[float32]
    location: str
    serial_number: str


@dataclass
class KeyValue(IdlStruct, typename=_dds("diagnostic_msgs", "KeyValue")):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename=_dds("diagnostic_msgs", "DiagnosticStatus")):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename=_dds("diagnostic_msgs", "DiagnosticArray")):
    header: Header
    status: sequence[DiagnosticStatus]


# rmw_cyclonedds puts who asked, and the how-manieth question it is, before a service's own fields.


@dataclass
class Bool(IdlStruct, typename=_dds("std_msgs", "Bool")):
    data: bool


@dataclass
class SetBoolRequest(IdlStruct, typename=_dds("std_srvs", "SetBool_Request", "srv")):
    client_guid: uint64
    sequence_number: int64
    data: bool


@dataclass
class SetBoolResponse(IdlStruct, typename=_dds("std_srvs", "SetBool_Response", "srv")):
    client_guid: uint64
    sequence_number: int64
    success: bool
    message: str


@dataclass
class TriggerRequest(IdlStruct, typename=_dds("std_srvs", "Trigger_Request", "srv")):
    client_guid: uint64
    sequence_number: int64
    structure_needs_at_least_one_member: uint8  # an empty message is one octet on the wire


@dataclass
class TriggerResponse(IdlStruct, typename=_dds("std_srvs", "Trigger_Response", "srv")):
    client_guid: uint64
    sequence_number: int64
    success: bool
    message: str


# How ROS 2 nodes over DDS know of each other (16-byte GIDs: since Iron).


@dataclass
class Gid(IdlStruct, typename=_dds("rmw_dds_common", "Gid")):
    data: array[uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename=_dds("rmw_dds_common", "NodeEntitiesInfo")):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(
    IdlStruct, typename=_dds("rmw_dds_common", "ParticipantEntitiesInfo")
):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]
