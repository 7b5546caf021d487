"""The keys of the bus: what each carries, in which direction, and for what.

``schemas/asyncapi.json`` is made of this table, and tests compare it with the daemon.
"""

from __future__ import annotations

import msgspec

from yahboomd.core.bus import keys
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
from yahboomd.ros2 import ros2_topics


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
    """

    request: type[msgspec.Struct] | None = None
    ros_type: str = ""
    does: str


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
    ros_types=ros2_topics.COMMAND_TYPES,
    does="drives the robot",
)

INPUTS: dict[str, Input] = {
    keys.CMD_VEL: COMMAND,
    keys.CMD_VEL_TELEOP: COMMAND,
    keys.CMD_VEL_WEB: COMMAND,
    keys.ESTOP: Input(
        messages=(EstopRequest,),
        ros_types=(ros2_topics.RECEIVED[keys.ESTOP],),
        does="engages the emergency stop, whatever its payload; only a well-formed "
        '`{"engaged": false}` is refused, and a `std_msgs/Bool` that is false changes nothing',
    ),
    keys.ODOMETRY_SET_POSE: Input(
        messages=(SetPoseRequest,),
        ros_types=(ros2_topics.RECEIVED[keys.ODOMETRY_SET_POSE],),
        does="sets the pose; a ROS 2 message has to be in the frame of the odometry",
    ),
}
"""Received commands, by key; each further name in ``[command.sources]`` takes commands as well."""

OFFERS: dict[str, Offer] = {
    keys.ESTOP: Offer(
        request=EstopRequest,
        ros_type=ros2_topics.SERVICES[keys.ESTOP],
        does="engages the emergency stop, and acknowledges that it was sent; "
        "wildcards may stand before the last part of its key",
    ),
    keys.ESTOP_RESET: Offer(
        ros_type=ros2_topics.SERVICES[keys.ESTOP_RESET],
        does="releases the emergency stop and clears a fault, "
        "unless a source commanded motion within the last second",
    ),
    keys.ODOMETRY_RESET: Offer(
        ros_type=ros2_topics.SERVICES[keys.ODOMETRY_RESET], does="sets the pose to zero"
    ),
    keys.ODOMETRY_SET_POSE: Offer(request=SetPoseRequest, does="sets the pose"),
    keys.CONFIG: Offer(does="returns the configuration in effect"),
    keys.BOARD: Offer(does="returns the board's answers at connecting: firmware and settings"),
    keys.BLACKBOX_SAVE: Offer(does="saves the black box, at most once a minute"),
}
"""The services, by key."""
