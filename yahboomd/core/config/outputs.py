"""The sections on output: odometry, Zenoh, ROS 2, page, log."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from yahboomd.core.config.values import (
    AbsolutePath,
    Camera,
    Endpoint,
    Frame,
    FramePrefix,
    Joint,
    Key,
    Section,
    SourceKey,
    Topic,
)


class Odometry(Section):
    """Rates, frames and noise of the odometry."""

    poll_rate_hz: float = Field(
        default=50.0,
        gt=0.0,
        le=1000.0,
        description="Requests for the counters per second, if the board has to be asked, at least "
        "5; one that streams sends them by itself, new ones every 10 ms.",
    )
    publish_rate_hz: float = Field(
        default=50.0,
        gt=0.0,
        le=1000.0,
        description="Greatest number of pose and twist samples per second.",
    )
    frame_id: Frame = Field(default="odom", description="Frame of the pose.")
    child_frame_id: Frame = Field(
        default="base_link", description="Frame of the twist: the base itself."
    )
    max_wheel_speed_m_s: float = Field(
        default=2.0,
        gt=0.0,
        le=50.0,
        description="Rim speed in m/s that no wheel reaches, even downhill; counts that would need "
        "more are ignored.",
    )
    heading: Literal["wheels", "fused"] = Field(
        default="wheels",
        description="The source of the heading. fused: wheels and gyro, if the board has one; "
        "check imu.axes first.",
    )
    on_restart: Literal["continue", "origin"] = Field(
        default="continue",
        description="The pose after a restart of yahboomd alone. continue: its last one, if the "
        "board went on counting; origin: zero.",
    )
    travel_noise_m: float = Field(
        default=0.0032,
        gt=0.0,
        le=1.0,
        description="Standard deviation, in metres, of a wheel's measured travel after one metre "
        "rolled; its square grows with the distance, and with it the covariance. A hard floor "
        "without slip: 0.0032.",
    )

    @property
    def noise_m(self) -> float:
        """Variance of a wheel's travel per metre rolled, in m^2 per m."""
        return self.travel_noise_m**2


class Zenoh(Section):
    """The bus: how applications reach the daemon, and the namespace of its keys."""

    mode: Literal["router", "peer", "client"] = Field(
        default="router",
        description="A router serves clients and peers alike; a client needs one to connect to.",
    )
    listen: tuple[Endpoint, ...] = Field(
        default=("tcp/127.0.0.1:7448",),
        strict=False,
        description="Where applications reach the daemon. Any program there can drive: beyond "
        "this machine, use TLS and access control.",
    )
    connect: tuple[Endpoint, ...] = Field(
        default=("tcp/127.0.0.1:7447",),
        strict=False,
        description="Routers to join when they are reachable; nothing waits for them. Any program "
        "at such a router can drive.",
    )
    namespace: Key = Field(
        default="", description="Prefix of every key, such as bot1; the name of this robot."
    )
    encoding: Literal["json", "msgpack"] = Field(
        default="json", description="Encoding of the native samples."
    )
    config: AbsolutePath = Field(
        default="",
        description="A Zenoh JSON5 file for everything else: TLS, users, access control.",
    )


class StaticTransform(Section):
    """A frame that is fixed to another, such as a laser to the base."""

    parent: Frame = Field(description="The frame that it is fixed to.")
    child: Frame = Field(description="The frame that is placed.")
    x: float = Field(default=0.0, description="Metres forward from the parent.")
    y: float = Field(default=0.0, description="Metres to the left.")
    z: float = Field(default=0.0, description="Metres up.")
    roll: float = Field(default=0.0, description="Radians about x, the parent's; applied first.")
    pitch: float = Field(default=0.0, description="Radians about y, the parent's.")
    yaw: float = Field(default=0.0, description="Radians about z, the parent's; applied last.")


class Ros2(Section):
    """The ROS 2 plane: topics for zenoh-bridge-ros2dds, or for rmw_zenoh's own graphs."""

    bridge: bool = Field(
        default=True, description="Publish CDR on plain keys, for zenoh-bridge-ros2dds."
    )
    rmw_zenoh: bool = Field(
        default=False, description="Appear as a node of rmw_zenoh, without a bridge."
    )
    distro: Literal["humble", "iron", "jazzy", "kilted", "lyrical", "rolling"] = Field(
        default="jazzy", description="The distribution of the ROS 2 graph."
    )
    domain_id: int = Field(
        default=0, ge=0, le=232, description="ROS_DOMAIN_ID of the rmw_zenoh graph."
    )
    stamped_commands: tuple[SourceKey, ...] = Field(
        default=(),
        strict=False,
        description="Command keys that are TwistStamped in ROS 2, such as cmd_vel for Nav2 of "
        "Kilted; all others are Twist. A topic carries one type.",
    )
    odom: bool = Field(default=True, description="Publish nav_msgs/Odometry.")
    publish_tf: bool = Field(
        default=True,
        description="Publish the transform from odom to base_link; off if another node, such "
        "as robot_localization, does.",
    )
    joint_states: bool = Field(default=True, description="Publish sensor_msgs/JointState.")
    imu: bool = Field(
        default=True, description="Publish sensor_msgs/Imu, if the board has a sensor."
    )
    battery_state: bool = Field(default=True, description="Publish sensor_msgs/BatteryState.")
    diagnostics: bool = Field(
        default=True, description="Publish diagnostic_msgs/DiagnosticArray, once a second."
    )
    odom_topic: Topic = Field(default="odom", description="Topic of the odometry.")
    joint_states_topic: Topic = Field(
        default="joint_states", description="Topic of the joint states."
    )
    imu_topic: Topic = Field(
        default="imu", description="Topic of the inertial sensor: data_raw and data below it."
    )
    battery_state_topic: Topic = Field(
        default="battery_state", description="Topic of the battery's state."
    )
    diagnostics_topic: Topic = Field(default="diagnostics", description="Topic of the diagnostics.")
    frame_prefix: FramePrefix = Field(
        default="",
        description="Prefix of every frame in ROS 2, used literally, such as bot1/; independent of "
        "the namespace.",
    )
    joint_names: dict[str, Joint] = Field(
        default={},
        description="Joint of each motor, by the motor's name; one that is missing is "
        "<motor>_wheel_joint.",
    )
    hardware_id: str = Field(
        default="",
        description="Name of this robot in diagnostics. Empty: zenoh.namespace, else the name of "
        "this machine.",
    )
    static_transforms: tuple[StaticTransform, ...] = Field(
        default=(),
        strict=False,
        description="Frames for /tf_static, if no robot_state_publisher publishes them.",
    )


class BlackBox(Section):
    """The black box: a record of the last minute, to see why the robot stopped."""

    enabled: bool = Field(
        default=True,
        description="Keep the last minute in memory, and save it at each fault, emergency stop, "
        "disconnect and crash.",
    )
    folder: AbsolutePath = Field(
        default="", description="Folder of the saved boxes. Empty: blackbox in the state directory."
    )


class Web(Section):
    """The page for the phone, which `yahboomd web` serves."""

    camera: Camera = Field(
        default="",
        description="Where the robot's camera is served as MJPEG, over plain HTTP. Empty: none.",
    )


class Log(Section):
    """The log."""

    level: Literal["debug", "info", "warning", "error"] = Field(
        default="info",
        description="The least serious line that is written; debug shows every frame.",
    )
