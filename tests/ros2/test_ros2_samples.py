"""Each message once, for those who listen."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import msgspec
import pytest
from ros_oracle import Oracle

from yahboomd.core.messages.native import StatusSample
from yahboomd.core.model import (
    Event,
    ImuEstimate,
    ImuReading,
    ImuSensor,
    OdometryEstimate,
    Pose2d,
    Severity,
    Twist2d,
)
from yahboomd.ros2.messages import ros2_names
from yahboomd.ros2.messages.ros2_names import Qos
from yahboomd.ros2.ros2_samples import Placed, RosPublisher, Spread, Topics
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time

STAMP_NS = 1_700_000_000_123_456_789
STAMP = {"sec": 1_700_000_000, "nanosec": 123_456_789}
ESTIMATE = OdometryEstimate(
    stamp_ns=5,
    pose=Pose2d(x=1.0, y=2.0, theta=3.0),
    twist=Twist2d(vx=0.1, wz=0.2),
    pose_covariance=(1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0),
    twist_covariance=(4.0, 0.0, 0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 6.0),
    motor_ticks=(10, 20),
    motor_position_rad=(0.5, 1.5),
    motor_speed_m_s=(0.25, 0.5),
)
STATUS = StatusSample(
    stamp_ns=STAMP_NS,
    state="standing",
    driver=None,
    since_ns=STAMP_NS,
    why="Because.",
    board={"dialect": "polled"},
    link={},
    command={},
    bus={},
)
TOPICS = Topics(
    frame_id="bot1/odom",
    child_frame_id="bot1/base_link",
    imu_frame_id="bot1/imu_link",
    joints=("left_wheel_joint", "right_wheel_joint"),
    radii_m=(0.05, 0.1),
)
LASER = Placed(parent="base_link", child="laser", position_m=(0.1, 0.0, 0.2))


class Outlet:
    def __init__(self) -> None:
        self.has_subscribers = True
        self.payloads: list[bytes] = []

    def put(self, payload: bytes) -> bool:
        self.payloads.append(payload)
        return True


class Graph:
    """Two ways into ROS 2 that keep the samples."""

    def __init__(self) -> None:
        self.types: dict[str, str] = {}
        self.qos: dict[str, Qos] = {}
        self.outlets: dict[str, tuple[Outlet, Outlet]] = {}
        self.oracle = Oracle()

    def open(self, topic: str, ros_type: str, qos: Qos) -> Spread:
        self.types[topic], self.qos[topic] = ros_type, qos
        outlets = self.outlets.setdefault(topic, (Outlet(), Outlet()))
        return Spread(outlets, forgetful=outlets[:1])

    def payloads(self, topic: str) -> list[bytes]:
        one, other = self.outlets[topic]
        assert one.payloads == other.payloads
        return one.payloads

    def latest(self, topic: str) -> Any:
        """The message as ROS 2 reads it; ROS 2 would write the same bytes."""
        payload, ros_type = self.payloads(topic)[-1], self.types[topic]
        message = self.oracle.store.deserialize_cdr(payload, ros_type)
        assert bytes(self.oracle.store.serialize_cdr(message, ros_type)) == payload
        return self.oracle.decode(ros_type, payload)


@pytest.fixture
def graph(oracle: Oracle) -> Graph:
    graph = Graph()
    graph.oracle = oracle
    return graph


async def test_all_of_one_reading_has_its_stamp_and_its_frames(graph: Graph) -> None:
    RosPublisher(graph.open, TOPICS, LoopClock()).estimate(ESTIMATE, STAMP_NS)
    odom, joints = graph.latest("odom"), graph.latest("joint_states")
    (transform,) = graph.latest("tf")["transforms"]
    assert odom["header"] == {"stamp": STAMP, "frame_id": "bot1/odom"} == transform["header"]
    assert odom["child_frame_id"] == "bot1/base_link" == transform["child_frame_id"]
    assert odom["pose"]["pose"]["position"] == transform["transform"]["translation"]
    assert odom["pose"]["pose"]["orientation"] == transform["transform"]["rotation"]
    assert odom["twist"]["twist"]["angular"]["z"] == 0.2
    assert joints["header"] == {"stamp": STAMP, "frame_id": "bot1/base_link"}


async def test_joints_turn_at_the_speed_of_the_rims_by_their_radii(graph: Graph) -> None:
    RosPublisher(graph.open, TOPICS, LoopClock()).estimate(ESTIMATE, STAMP_NS)
    joints = graph.latest("joint_states")
    assert joints["name"] == ["left_wheel_joint", "right_wheel_joint"]
    assert joints["position"] == [0.5, 1.5]
    assert joints["velocity"] == [5.0, 5.0]
    assert joints["effort"] == []


async def test_the_battery_tells_what_is_measured_and_nothing_else(graph: Graph) -> None:
    RosPublisher(graph.open, TOPICS, LoopClock()).battery(7.5, STAMP_NS)
    battery = graph.latest("battery_state")
    assert (battery["voltage"], battery["present"]) == (7.5, True)
    assert math.isnan(battery["percentage"])
    assert battery["header"] == {"stamp": STAMP, "frame_id": "bot1/base_link"}
    assert graph.qos["battery_state"] == Qos(reliable=True, latched=True, depth=1)


IMU = ImuEstimate(
    reading=ImuReading(
        sensor=ImuSensor(
            name="any",
            gyro_limit_rad_s=8.0,
            gyro_noise_rad_s=0.5,
            acceleration_limit_m_s2=20.0,
            acceleration_noise_m_s2=0.25,
        ),
        sent_ns=0,
        gyro_rad_s=(0.125, 0.25, 0.5),
        acceleration_m_s2=(0.5, -0.25, 9.75),
    ),
    stamp_ns=0,
    bias_rad_s=0.125,
    bias_variance=0.0625,
    theta=math.pi / 2.0,
    theta_variance=0.015625,
)


async def test_the_inertial_sensor_is_published_raw_and_with_the_heading(graph: Graph) -> None:
    RosPublisher(graph.open, TOPICS, LoopClock()).imu(IMU, STAMP_NS)
    raw, data = graph.latest("imu/data_raw"), graph.latest("imu/data")
    for each in (raw, data):
        assert each["header"] == {"stamp": STAMP, "frame_id": "bot1/imu_link"}
        assert each["linear_acceleration"] == {"x": 0.5, "y": -0.25, "z": 9.75}
        assert list(each["linear_acceleration_covariance"])[::4] == [0.0625] * 3
    # REP 145: -1 without an orientation.
    assert raw["orientation"] == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    assert list(raw["orientation_covariance"]) == [-1.0] + [0.0] * 8
    assert raw["angular_velocity"] == {"x": 0.125, "y": 0.25, "z": 0.5}
    assert list(raw["angular_velocity_covariance"])[::4] == [0.25] * 3
    assert data["orientation"]["z"] == pytest.approx(math.sin(math.pi / 4.0))
    assert list(data["orientation_covariance"])[::4] == [1e6, 1e6, 0.015625]
    assert data["angular_velocity"]["z"] == 0.375
    assert list(data["angular_velocity_covariance"])[::4] == [0.25, 0.25, 0.3125]


async def test_a_board_without_a_sensor_has_no_such_topics(graph: Graph) -> None:
    RosPublisher(graph.open, TOPICS, LoopClock()).estimate(ESTIMATE, STAMP_NS)
    assert not [topic for topic in graph.types if "imu" in topic]


async def test_the_sensor_can_be_left_out_and_named_otherwise(graph: Graph) -> None:
    for imu in ("", "head/imu"):
        topics = msgspec.structs.replace(TOPICS, imu=imu)
        RosPublisher(graph.open, topics, LoopClock()).imu(IMU, STAMP_NS)
    named = {topic for topic in graph.types if "imu" in topic}
    assert named == {"head/imu/data", "head/imu/data_raw"}


@pytest.mark.parametrize(
    ("volts", "charge"),
    [(8.0, 0.1), (9.0, 0.1), (9.5, 0.3), (10.0, 0.5), (11.5, 0.875), (12.0, 1.0), (15.0, 1.0)],
)
async def test_the_charge_follows_the_curve(graph: Graph, volts: float, charge: float) -> None:
    curve = ((9.0, 0.1), (10.0, 0.5), (12.0, 1.0))
    topics = msgspec.structs.replace(TOPICS, battery_curve=curve)
    RosPublisher(graph.open, topics, LoopClock()).battery(volts, STAMP_NS)
    assert graph.latest("battery_state")["percentage"] == pytest.approx(charge)


async def test_nothing_is_encoded_without_a_subscriber(graph: Graph) -> None:
    publisher = RosPublisher(graph.open, TOPICS, LoopClock())
    for outlets in graph.outlets.values():
        for outlet in outlets:
            outlet.has_subscribers = False
    # Reading it would fail.
    nothing: Any = None
    publisher.estimate(nothing, nothing)
    publisher.battery(nothing, nothing)
    publisher.status(nothing)
    assert all(not o.payloads for outlets in graph.outlets.values() for o in outlets)


def test_a_sample_goes_where_somebody_listens() -> None:
    heard, unheard = Outlet(), Outlet()
    unheard.has_subscribers = False
    both = Spread((unheard, heard))
    assert both.has_subscribers
    both.put(b"sample")
    assert (heard.payloads, unheard.payloads) == ([b"sample"], [])


async def test_what_is_switched_off_has_no_topic(graph: Graph) -> None:
    none = Topics(
        odom="",
        transform=False,
        joint_states="",
        battery_state="",
        diagnostics="",
        joints=("a", "b"),
        radii_m=(1.0, 1.0),
    )
    publisher = RosPublisher(graph.open, none, LoopClock())
    publisher.place()
    publisher.estimate(ESTIMATE, STAMP_NS)
    publisher.battery(7.5, STAMP_NS)
    publisher.status(STATUS)
    # The emergency stop is not to be switched off, and nor is what tells of it, and of faults.
    assert graph.types == {"estopped": ros2_names.BOOL, "rosout": ros2_names.LOG}


async def test_events_are_lines_of_the_nodes_log(graph: Graph) -> None:
    publisher = RosPublisher(graph.open, TOPICS, LoopClock())
    assert graph.qos["rosout"] == Qos(reliable=True, latched=True, depth=1000)
    levels_by_severity: dict[Severity, int] = {"info": 20, "warning": 30, "error": 40}
    for severity, level in levels_by_severity.items():
        event = Event(kind="connected", severity=severity, message="The board is there.")
        publisher.event(event, STAMP_NS)
        line = graph.latest("rosout")
        assert (line["stamp"], line["level"], line["name"]) == (STAMP, level, "yahboomd")
        assert (line["msg"], line["function"]) == ("The board is there.", "connected")


async def test_whether_the_estop_is_engaged_is_latched_said_at_once_and_again(
    graph: Graph,
) -> None:
    publisher = RosPublisher(graph.open, TOPICS, LoopClock())
    assert graph.qos["estopped"] == Qos(reliable=True, latched=True, depth=1)
    for state, said in (("standing", 1), ("standing", 1), ("estopped", 2), ("fault", 3)):
        publisher.status(msgspec.structs.replace(STATUS, state=state))
        assert len(graph.payloads("estopped")) == said
        assert graph.latest("estopped") == {"data": state == "estopped"}
    await asyncio.sleep(1.0)
    publisher.status(msgspec.structs.replace(STATUS, state="fault"))
    assert len(graph.payloads("estopped")) == 4


async def test_static_frames_are_latched_and_stand_as_configured(graph: Graph) -> None:
    topics = Topics(joints=("a",), radii_m=(1.0,), static=(LASER,))
    RosPublisher(graph.open, topics, LoopClock()).place()
    assert graph.qos["tf_static"] == Qos(reliable=True, latched=True, depth=1)
    assert not graph.qos["tf"].latched
    (transform,) = graph.latest("tf_static")["transforms"]
    assert transform["header"]["frame_id"] == "base_link"
    assert transform["child_frame_id"] == "laser"
    assert transform["transform"] == {
        "translation": {"x": 0.1, "y": 0.0, "z": 0.2},
        "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    }


@on_virtual_time
async def test_static_frames_are_repeated_where_they_may_be_lost_alone(graph: Graph) -> None:
    publisher = RosPublisher(
        graph.open, Topics(joints=("a",), radii_m=(1.0,), static=(LASER,)), LoopClock()
    )
    publisher.place()
    for _ in range(20):
        publisher.status(STATUS)
        await asyncio.sleep(0.5)
    bridge, native = (outlet.payloads for outlet in graph.outlets["tf_static"])
    assert len(native) == 1
    assert bridge == native * 11


@on_virtual_time
async def test_diagnostics_come_once_a_second_and_at_once_when_a_level_changes(
    graph: Graph,
) -> None:
    publisher = RosPublisher(graph.open, TOPICS, LoopClock())
    for _ in range(20):
        publisher.status(STATUS)
        await asyncio.sleep(0.5)
    assert len(graph.payloads("diagnostics")) == 10
    publisher.status(msgspec.structs.replace(STATUS, state="estopped"))
    publisher.status(msgspec.structs.replace(STATUS, state="estopped"))
    before = len(graph.payloads("diagnostics"))
    publisher.status(STATUS)
    assert len(graph.payloads("diagnostics")) == before + 1
    message = graph.latest("diagnostics")
    assert message["header"]["stamp"] == STAMP
    names = [entry["name"] for entry in message["status"]]
    assert names == [f"yahboomd: {what}" for what in ("base", "pose", "board", "commands", "bus")]


@on_virtual_time
async def test_static_frames_are_repeated_without_a_reader_of_diagnostics(graph: Graph) -> None:
    topics = Topics(joints=("a",), radii_m=(1.0,), static=(LASER,))
    publisher = RosPublisher(graph.open, topics, LoopClock())
    for outlet in graph.outlets["diagnostics"]:
        outlet.has_subscribers = False
    for _ in range(6):
        publisher.status(STATUS)
        await asyncio.sleep(0.5)
    bridge = graph.outlets["tf_static"][0].payloads
    assert len(bridge) == 3
    assert len(set(bridge)) == 1
    assert graph.types["tf_static"] == ros2_names.TF_MESSAGE
