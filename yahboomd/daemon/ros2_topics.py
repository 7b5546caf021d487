"""Samples for ROS 2: each message encoded once, for all ways that it goes, if anybody listens."""

from __future__ import annotations

from typing import Protocol

import msgspec

from yahboomd.bus import keys
from yahboomd.clock import Clock, nanoseconds
from yahboomd.daemon.diagnostics import Diagnostics, levels
from yahboomd.daemon.key_table import ROS_TOPICS
from yahboomd.daemon.publisher import Outlet, Pace
from yahboomd.messages import cdr, planar
from yahboomd.messages.native import StatusSample
from yahboomd.messages.ros2 import Qos
from yahboomd.model import OdometryEstimate

DIAGNOSTICS_EVERY_S = 1.0


class Placed(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that does not move against its parent: metres, and a quaternion (x, y, z, w)."""

    parent: str
    child: str
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


class Topics(msgspec.Struct, frozen=True, kw_only=True):
    """What is published, under which names. An empty topic is not published.

    Attributes:
        odom: Topic of nav_msgs/Odometry.
        transform: Whether the transform from ``frame_id`` to ``child_frame_id`` goes to ``tf``.
        joint_states: Topic of sensor_msgs/JointState.
        battery_state: Topic of sensor_msgs/BatteryState.
        diagnostics: Topic of diagnostic_msgs/DiagnosticArray.
        frame_id: Frame of the pose, with its prefix like all frames here.
        child_frame_id: Frame of the base.
        static: Frames for ``tf_static``, which is not published without any.
        joints: The joint of each motor, in the order of the estimates.
        radii_m: The radius of each motor's wheel.
        hardware_id: Tells this robot from others in the diagnostics.
    """

    odom: str = "odom"
    transform: bool = True
    joint_states: str = "joint_states"
    battery_state: str = "battery_state"
    diagnostics: str = "diagnostics"
    frame_id: str = "odom"
    child_frame_id: str = "base_link"
    static: tuple[Placed, ...] = ()
    joints: tuple[str, ...]
    radii_m: tuple[float, ...]
    hardware_id: str = "yahboomd"


class OpenTopic(Protocol):
    """Opens the outlets of a topic, one for each way into ROS 2."""

    def __call__(self, topic: str, ros_type: str, qos: Qos) -> tuple[Outlet, ...]:
        """The outlets."""
        ...


class Spread:
    """One sample to several outlets.

    Args:
        outlets: Where it goes.
    """

    def __init__(self, outlets: tuple[Outlet, ...] = ()) -> None:
        self._outlets = outlets

    @property
    def has_subscribers(self) -> bool:
        """Whether anybody would get it."""
        return any(outlet.has_subscribers for outlet in self._outlets)

    def put(self, payload: bytes) -> None:
        """Send one, to those outlets where somebody listens."""
        for outlet in self._outlets:
            if outlet.has_subscribers:
                outlet.put(payload)


class RosPublisher:
    """The ROS 2 plane. All that it tells of one reading carries the stamp it is given.

    Args:
        open_topic: Opens a topic.
        topics: What is published, and how it is called.
        clock: Paces the diagnostics.
    """

    def __init__(self, open_topic: OpenTopic, topics: Topics, clock: Clock) -> None:
        def opened(topic: str, default: str) -> Spread:
            row = ROS_TOPICS[default]
            return Spread(open_topic(topic, row.ros_type, row.qos)) if topic else Spread()

        frames = topics.frame_id, topics.child_frame_id
        self._clock = clock
        self._radii_m = topics.radii_m
        self._odom = opened(topics.odom, keys.ROS_ODOM)
        self._tf = opened(keys.ROS_TF if topics.transform else "", keys.ROS_TF)
        self._joints = opened(topics.joint_states, keys.ROS_JOINT_STATES)
        self._battery = opened(topics.battery_state, keys.ROS_BATTERY_STATE)
        self._diagnostics = opened(topics.diagnostics, keys.ROS_DIAGNOSTICS)
        self._static = opened(keys.ROS_TF_STATIC if topics.static else "", keys.ROS_TF_STATIC)
        self._fixed = _fixed(topics.static, clock.wall_ns()) if topics.static else b""
        self._encode_odom = planar.odometry(*frames)
        self._encode_tf = planar.transform(*frames)
        self._encode_joints = cdr.joint_state("", topics.joints)
        self._encode_battery = cdr.battery_state("")
        self._entries = Diagnostics(hardware_id=topics.hardware_id)
        self._pace = Pace(nanoseconds(DIAGNOSTICS_EVERY_S))
        self._levels: tuple[int, ...] = ()

    def place(self) -> None:
        """Publish the frames that do not move. A late reader gets them from a cache.

        They are published again with the diagnostics all the same: a bridge that is a router and
        restarts may not ask the cache.
        """
        if self._fixed:
            self._static.put(self._fixed)

    def estimate(self, estimate: OdometryEstimate, stamp_ns: int) -> None:
        """Publish one reading. Its stamp is new: tf2 takes a repeated transform for a mistake."""
        if self._odom.has_subscribers:
            self._odom.put(self._encode_odom(stamp_ns, estimate))
        if self._tf.has_subscribers:
            self._tf.put(self._encode_tf(stamp_ns, estimate.pose))
        if self._joints.has_subscribers:
            speeds = zip(estimate.motor_speed_m_s, self._radii_m, strict=True)
            turning = [speed_m_s / radius_m for speed_m_s, radius_m in speeds]
            self._joints.put(self._encode_joints(stamp_ns, estimate.motor_position_rad, turning))

    def battery(self, volts: float, stamp_ns: int) -> None:
        """Publish the voltage."""
        if self._battery.has_subscribers:
            self._battery.put(self._encode_battery(stamp_ns, volts))

    def status(self, sample: StatusSample) -> None:
        """Publish the diagnostics: once a second, and at once when a level changes."""
        is_due = self._pace.due(self._clock.now_ns())
        if is_due:
            self.place()
        if not self._diagnostics.has_subscribers:
            return
        entries = self._entries.of(sample)
        if is_due or levels(entries) != self._levels:
            self._levels = levels(entries)
            self._diagnostics.put(cdr.diagnostics(sample.stamp_ns, "", entries))


def _fixed(frames: tuple[Placed, ...], stamp_ns: int) -> bytes:
    encode = cdr.transforms([(each.parent, each.child) for each in frames])
    return encode(stamp_ns, [(*each.position_m, *each.rotation) for each in frames])
