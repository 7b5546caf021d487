"""Samples for ROS 2, each encoded once for all ways it goes."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Mapping
from typing import Protocol

import msgspec

from yahboomd.core.clock import Clock, nanoseconds
from yahboomd.core.daemon.publisher import Outlet, Pace
from yahboomd.core.messages.native import StatusSample
from yahboomd.core.model import Event, ImuEstimate, OdometryEstimate
from yahboomd.ros2 import ros2_topics
from yahboomd.ros2.messages import planar, ros2_encoders
from yahboomd.ros2.messages.rcl_interfaces import LEVELS, log
from yahboomd.ros2.messages.ros2_names import NODE, Qos
from yahboomd.ros2.ros2_diagnostics import Diagnostics, levels

DIAGNOSTICS_EVERY_S = 1.0


class Placed(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that does not move against its parent: metres, and a quaternion (x, y, z, w)."""

    parent: str
    child: str
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


class Topics(msgspec.Struct, frozen=True, kw_only=True):
    """The names under which samples are published. An empty topic is not published.

    Attributes:
        transform: Whether the transform from ``frame_id`` to ``child_frame_id`` goes to ``tf``.
        imu: Topic below which sensor_msgs/Imu goes, as ``data_raw`` and ``data``.
        frame_id: Frame of the pose, with its prefix like all frames here.
        static: Frames for ``tf_static``, which is not published without any.
        joints: The joint of each motor, in the order of the estimates.
        radii_m: The radius of each motor's wheel.
        hardware_id: Distinguishes this robot from others in the diagnostics.
        battery_curve: Points (volts, charge from 0 to 1), the volts rising; unknown without any.
    """

    odom: str = "odom"
    transform: bool = True
    joint_states: str = "joint_states"
    imu: str = "imu"
    imu_frame_id: str = "imu_link"
    battery_state: str = "battery_state"
    diagnostics: str = "diagnostics"
    frame_id: str = "odom"
    child_frame_id: str = "base_link"
    static: tuple[Placed, ...] = ()
    joints: tuple[str, ...]
    radii_m: tuple[float, ...]
    hardware_id: str = "yahboomd"
    battery_curve: tuple[tuple[float, float], ...] = ()


class Spread:
    """One sample to several outlets.

    Args:
        forgetful: Those of them that may lose latched samples when a program restarts.
    """

    def __init__(
        self, outlets: tuple[Outlet, ...] = (), forgetful: tuple[Outlet, ...] = ()
    ) -> None:
        self._outlets = outlets
        self._forgetful = forgetful

    @property
    def has_subscribers(self) -> bool:
        for outlet in self._outlets:  # noqa: SIM110 - any() costs three times as much
            if outlet.has_subscribers:
                return True
        return False

    def put(self, payload: bytes) -> None:
        for outlet in self._outlets:
            if outlet.has_subscribers:
                outlet.put(payload)

    def repeat(self, payload: bytes) -> None:
        """Send a latched sample again to the outlets that may lose it."""
        for outlet in self._forgetful:
            outlet.put(payload)


class OpenTopic(Protocol):
    """Opens a topic on each way into ROS 2."""

    def __call__(self, topic: str, ros_type: str, qos: Qos) -> Spread:
        """Open a topic; returns its outlets."""


class RosPublisher:
    """The ROS 2 plane. All samples of one reading have its stamp.

    Args:
        type_warnings: Which sources of commands publish another type, at a monotonic time.
    """

    def __init__(
        self,
        open_topic: OpenTopic,
        topics: Topics,
        clock: Clock,
        type_warnings: Callable[[int], Mapping[str, str]] = lambda _: {},
    ) -> None:
        def opened(topic: str, default: str) -> Spread:
            row = ros2_topics.ROS_TOPICS[default]
            return open_topic(topic, row.ros_type, row.qos) if topic else Spread()

        def open_imu() -> tuple[Spread, Spread]:
            named = (
                (f"{topics.imu}/data", ros2_topics.IMU),
                (f"{topics.imu}/data_raw", ros2_topics.IMU_RAW),
            )
            one, other = (opened(name if topics.imu else "", key) for name, key in named)
            return one, other

        frames = topics.frame_id, topics.child_frame_id
        self._open_imu = open_imu
        self._imu: tuple[Spread, Spread] | None = None
        self._encode_imu = planar.imu(topics.imu_frame_id)
        self._encode_imu_raw = planar.imu_raw(topics.imu_frame_id)
        self._clock = clock
        self._type_warnings = type_warnings
        self._radii_m = topics.radii_m
        self._odom = opened(topics.odom, ros2_topics.ODOM)
        self._tf = opened(ros2_topics.TF if topics.transform else "", ros2_topics.TF)
        self._joints = opened(topics.joint_states, ros2_topics.JOINT_STATES)
        self._battery = opened(topics.battery_state, ros2_topics.BATTERY_STATE)
        self._diagnostics = opened(topics.diagnostics, ros2_topics.DIAGNOSTICS)
        self._estopped = opened(ros2_topics.ESTOPPED, ros2_topics.ESTOPPED)
        self._rosout = opened(ros2_topics.ROSOUT, ros2_topics.ROSOUT)
        self._was_estopped: bool | None = None
        self._static = opened(ros2_topics.TF_STATIC if topics.static else "", ros2_topics.TF_STATIC)
        self._fixed = _fixed(topics.static, clock.wall_ns()) if topics.static else b""
        self._encode_odom = planar.odometry(*frames)
        self._encode_tf = planar.transform(*frames)
        self._base = topics.child_frame_id
        self._encode_joints = ros2_encoders.joint_state(self._base, topics.joints)
        self._encode_battery = ros2_encoders.battery_state(self._base)
        self._battery_curve = topics.battery_curve
        self._entries = Diagnostics(hardware_id=topics.hardware_id)
        self._pace = Pace(nanoseconds(DIAGNOSTICS_EVERY_S))
        self._levels: tuple[int, ...] = ()

    def place(self) -> None:
        """Publish the frames that do not move. A late reader gets them from a cache."""
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

    def imu(self, estimate: ImuEstimate, stamp_ns: int) -> None:
        """Publish a sample of the inertial sensor. Boards without one have no such topics."""
        if self._imu is None:
            self._imu = self._open_imu()
        imu, raw = self._imu
        if imu.has_subscribers:
            imu.put(self._encode_imu(stamp_ns, estimate))
        if raw.has_subscribers:
            raw.put(self._encode_imu_raw(stamp_ns, estimate))

    def battery(self, volts: float, stamp_ns: int) -> None:
        if self._battery.has_subscribers:
            charge = charge_of(volts, self._battery_curve)
            self._battery.put(self._encode_battery(stamp_ns, volts, charge))

    def event(self, event: Event, stamp_ns: int) -> None:
        """Publish an event as a line of the node's log."""
        if self._rosout.has_subscribers:
            level = LEVELS[event.severity]
            self._rosout.put(log(stamp_ns, level, NODE, event.message, event.kind))

    def status(self, sample: StatusSample) -> None:
        """Publish diagnostics and e-stop: once a second, and at once when they change."""
        now_ns = self._clock.now_ns()
        is_due = self._pace.due(now_ns)
        type_warnings = self._type_warnings(now_ns)
        if is_due and self._fixed:
            # A bridge that is a router and restarts may not ask the cache.
            self._static.repeat(self._fixed)
        if self._estopped.has_subscribers:
            estopped = sample.state == "estopped"
            if is_due or estopped != self._was_estopped:
                self._was_estopped = estopped
                self._estopped.put(ros2_encoders.boolean(estopped))
        if not self._diagnostics.has_subscribers:
            return
        entries = self._entries.of(sample, type_warnings)
        if is_due or levels(entries) != self._levels:
            self._levels = levels(entries)
            self._diagnostics.put(ros2_encoders.diagnostics(sample.stamp_ns, self._base, entries))


def charge_of(volts: float, curve: tuple[tuple[float, float], ...]) -> float:
    """The charge of a battery, from 0 to 1, on straight lines between points (volts, charge).

    Args:
        curve: The points, their volts rising; beyond its ends the charge stays. NaN without any.
    """
    if not curve:
        return math.nan
    above = bisect.bisect_right(curve, volts, key=lambda point: point[0])
    if above == 0 or above == len(curve):
        return curve[min(above, len(curve) - 1)][1]
    (low, charge), (high, next_charge) = curve[above - 1], curve[above]
    return charge + (next_charge - charge) * (volts - low) / (high - low)


def _fixed(frames: tuple[Placed, ...], stamp_ns: int) -> bytes:
    encode = ros2_encoders.transforms([(each.parent, each.child) for each in frames])
    return encode(stamp_ns, [(*each.position_m, *each.rotation) for each in frames])
