"""The keys of the bus: what each carries, in which direction, and with which QoS.

The daemon declares these keys, and ``schemas/asyncapi.json`` is made of them. Zenoh delivers
all samples over reliable links, but drops those that find a connection full: the thread that
publishes drives the wheels.
"""

from __future__ import annotations

import msgspec

from yahboomd.core.bus import keys
from yahboomd.core.messages import ros2
from yahboomd.core.messages.native import (
    BatterySample,
    EstopRequest,
    EventSample,
    ImuSample,
    PoseSample,
    RosVelocityCommand,
    SetPoseRequest,
    StatusSample,
    TwistSample,
    VelocityCommand,
    WheelsSample,
)
from yahboomd.core.messages.ros2 import Qos


class Output(msgspec.Struct, frozen=True, kw_only=True):
    """A key on which yahboomd publishes a native message."""

    message: type[msgspec.Struct]
    when: str


class Input(msgspec.Struct, frozen=True, kw_only=True):
    """A key on which yahboomd receives samples.

    Attributes:
        messages: The messages that it takes, in JSON or MessagePack.
        ros_types: The types that it takes, in CDR.
    """

    messages: tuple[type[msgspec.Struct], ...]
    ros_types: tuple[str, ...]
    does: str


class Offer(msgspec.Struct, frozen=True, kw_only=True):
    """A key on which yahboomd answers queries with a ``ServiceReply``.

    Attributes:
        request: The payload of the query; None if it needs none.
        ros_type: The ROS 2 type of the service; empty if it has none.
        wildcards: Whether a query by a key expression with wildcards is answered.
    """

    request: type[msgspec.Struct] | None = None
    ros_type: str = ""
    does: str
    wildcards: bool = False


class RosTopic(msgspec.Struct, frozen=True, kw_only=True):
    """A topic that yahboomd publishes for ROS 2, in CDR."""

    ros_type: str
    when: str
    qos: Qos = Qos(depth=10)


OUTPUTS: dict[str, Output] = {
    keys.POSE: Output(message=PoseSample, when="for each new reading"),
    keys.TWIST: Output(message=TwistSample, when="for each new reading"),
    keys.WHEELS: Output(message=WheelsSample, when="for each new reading"),
    keys.IMU: Output(message=ImuSample, when="for each sample of a board that has a sensor"),
    keys.BATTERY: Output(message=BatterySample, when="for each voltage that the board reports"),
    keys.STATUS: Output(message=StatusSample, when="twice a second, and when the state changes"),
    keys.EVENTS: Output(message=EventSample, when="as they happen"),
}
"""The native samples, by key. A query on :data:`~yahboomd.core.bus.keys.SAMPLES` is answered with
the newest sample."""

COMMAND = Input(
    messages=(VelocityCommand, RosVelocityCommand),
    ros_types=(ros2.TWIST, ros2.TWIST_STAMPED),
    does="drives the robot",
)

INPUTS: dict[str, Input] = {
    keys.CMD_VEL: COMMAND,
    keys.CMD_VEL_TELEOP: COMMAND,
    keys.CMD_VEL_WEB: COMMAND,
    keys.ESTOP: Input(
        messages=(EstopRequest,),
        ros_types=(ros2.BOOL,),
        does="engages the emergency stop, whatever its payload; only a well-formed "
        '`{"engaged": false}` is refused, and a `std_msgs/Bool` that is false changes nothing',
    ),
    keys.ODOMETRY_SET_POSE: Input(
        messages=(SetPoseRequest,),
        ros_types=(ros2.POSE,),
        does="sets the pose; a ROS 2 message has to be in the frame of the odometry",
    ),
}
"""Received commands, by key; each further name in ``[command.sources]`` takes commands as well."""

OFFERS: dict[str, Offer] = {
    keys.ESTOP: Offer(
        request=EstopRequest,
        ros_type=ros2.SET_BOOL,
        does="engages the emergency stop, and acknowledges that it was sent; "
        "wildcards may stand before the last part of its key",
    ),
    keys.ESTOP_RESET: Offer(
        ros_type=ros2.TRIGGER,
        does="releases the emergency stop and clears a fault, "
        "unless a source commanded motion within the last second",
    ),
    keys.ODOMETRY_RESET: Offer(ros_type=ros2.TRIGGER, does="sets the pose to zero"),
    keys.ODOMETRY_SET_POSE: Offer(request=SetPoseRequest, does="sets the pose"),
    keys.CONFIG: Offer(does="returns the configuration in effect", wildcards=True),
    keys.BOARD: Offer(
        does="returns the board's answers at connecting: firmware and settings", wildcards=True
    ),
    keys.BLACKBOX_SAVE: Offer(does="saves the black box, at most once a minute"),
}
"""The services, by key."""

ROS_TOPICS: dict[str, RosTopic] = {
    keys.ROS_ODOM: RosTopic(ros_type=ros2.ODOMETRY, when="for each new reading"),
    keys.ROS_TF: RosTopic(
        ros_type=ros2.TF_MESSAGE, when="for each new reading", qos=Qos(depth=100)
    ),
    keys.ROS_TF_STATIC: RosTopic(
        ros_type=ros2.TF_MESSAGE,
        when="once; to the bridge, once a second",
        qos=Qos(latched=True, depth=1),
    ),
    keys.ROS_JOINT_STATES: RosTopic(ros_type=ros2.JOINT_STATE, when="for each new reading"),
    keys.ROS_IMU: RosTopic(
        ros_type=ros2.IMU, when="for each sample, with orientation and without bias"
    ),
    keys.ROS_IMU_RAW: RosTopic(ros_type=ros2.IMU, when="for each sample, as the sensor shows it"),
    keys.ROS_BATTERY_STATE: RosTopic(
        ros_type=ros2.BATTERY_STATE,
        when="for each voltage that the board reports",
        qos=Qos(latched=True, depth=1),
    ),
    keys.ROS_ESTOPPED: RosTopic(
        ros_type=ros2.BOOL,
        when="when the emergency stop is engaged or released, and once a second",
        qos=Qos(latched=True, depth=1),
    ),
    keys.ROS_DIAGNOSTICS: RosTopic(
        ros_type=ros2.DIAGNOSTIC_ARRAY, when="once a second, and when a level changes"
    ),
    keys.ROS_ROSOUT: RosTopic(
        ros_type=ros2.LOG, when="for each event", qos=Qos(latched=True, depth=1000)
    ),
}
"""The topics of ROS 2, by the names that they have unless configured otherwise."""
