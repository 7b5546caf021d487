"""Wheels and poses out of bags that a library wrote."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from yahboomd.cli.main import main
from yahboomd.core.config import Config, read
from yahboomd.core.errors import Refused
from yahboomd.tools.calibrate.recorded_poses import JOINTS, tracks

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
TRACK_M, RADIUS_M = 0.150, 0.0335
TRUE_RADIUS, TRUE_TRACK = 1.02, 1.05


def stamp(at_s: float):
    return TYPES["builtin_interfaces/msg/Time"](int(at_s), round(at_s % 1.0 * 1e9))


def header(at_s: float, frame: str):
    return TYPES["std_msgs/msg/Header"](stamp(at_s), frame)


def quaternion(heading: float):
    return TYPES["geometry_msgs/msg/Quaternion"](
        0.0, 0.0, math.sin(heading / 2), math.cos(heading / 2)
    )


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two minutes of curves; the wheels are 2 % larger and 5 % farther apart than configured."""
    folder = tmp_path_factory.mktemp("bags") / "run"
    names = ["left_wheel_joint", "right_wheel_joint"]
    with Writer(folder, version=9) as writer:
        joints = writer.add_connection(
            "/joint_states", "sensor_msgs/msg/JointState", typestore=STORE
        )
        transforms = writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=STORE)
        odometry = writer.add_connection("/slam", "nav_msgs/msg/Odometry", typestore=STORE)
        x = y = heading = 0.0
        turned = np.zeros(2)
        for number in range(6000):
            at_s = 1000.0 + number * 0.02
            at_ns = round(at_s * 1e9)
            if number:
                v, w = 0.2 + 0.1 * math.sin(at_s / 7), math.sin(at_s / 3) + 0.3
                heading += w * 0.01
                x, y = x + v * 0.02 * math.cos(heading), y + v * 0.02 * math.sin(heading)
                heading += w * 0.01
                side = w * TRACK_M * TRUE_TRACK / 2
                turned += np.array([v - side, v + side]) * 0.02 / (RADIUS_M * TRUE_RADIUS)
            state = TYPES[JOINTS](header(at_s, ""), names, turned.copy(), np.zeros(0), np.zeros(0))
            writer.write(joints, at_ns, STORE.serialize_cdr(state, JOINTS))
            if number % 5:
                continue
            # The sensor sits 0.1 m ahead.
            px, py = x + 0.1 * math.cos(heading), y + 0.1 * math.sin(heading)
            transform = TYPES["geometry_msgs/msg/Transform"](
                TYPES["geometry_msgs/msg/Vector3"](px, py, 0.0), quaternion(heading)
            )
            tf = TYPES["tf2_msgs/msg/TFMessage"](
                [
                    TYPES["geometry_msgs/msg/TransformStamped"](
                        header(at_s, "map"), "laser", transform
                    )
                ]
            )
            writer.write(transforms, at_ns, STORE.serialize_cdr(tf, "tf2_msgs/msg/TFMessage"))
            pose = TYPES["geometry_msgs/msg/Pose"](
                TYPES["geometry_msgs/msg/Point"](px, py, 0.0), quaternion(heading)
            )
            zero = TYPES["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
            odom = TYPES["nav_msgs/msg/Odometry"](
                header(at_s, "map"),
                "laser",
                TYPES["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
                TYPES["geometry_msgs/msg/TwistWithCovariance"](
                    TYPES["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36)
                ),
            )
            writer.write(odometry, at_ns, STORE.serialize_cdr(odom, "nav_msgs/msg/Odometry"))
    return folder


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    "options", [("--frames", "map", "laser"), ("--topic", "/slam")], ids=["tf", "odometry"]
)
def test_a_recording_calibrates_the_robot(
    bag: Path, options, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    assert main(["calibrate", "poses", str(bag), *options]) == 0
    assert "The sensor sits 0.100 m ahead" in capsys.readouterr().err
    chassis = read(None, environ={"STATE_DIRECTORY": str(tmp_path)}).config.chassis
    assert chassis.wheel_separation_multiplier == pytest.approx(TRUE_TRACK, rel=1e-3)
    assert chassis.wheel_radius_multiplier == pytest.approx(
        {"left": TRUE_RADIUS, "right": TRUE_RADIUS}, rel=1e-3
    )


def test_what_is_not_there_is_named_with_what_is(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(Refused, match=r"no poses of map to camera on /tf\. It has /joint_states"):
        tracks([bag], Config(), topic="/tf", frames=("map", "camera"))
    other = read(None, environ={}, overrides=["chassis.preset=4wd"]).config
    with pytest.raises(Refused, match="no joint states of"):
        tracks([bag], other, topic="/slam", frames=None)
    with pytest.raises(Refused, match=r"There is no recording .*none"):
        tracks([tmp_path / "none"], Config(), topic="/slam", frames=None)


@pytest.mark.cases(1)
@pytest.mark.parametrize("left", [0, 100, 40_000, 300_000])
def test_a_damaged_bag_is_refused_in_words(bag: Path, tmp_path: Path, left: int) -> None:
    shutil.copytree(bag, tmp_path / "run")
    (file,) = (tmp_path / "run").glob("*.db3")
    data = file.read_bytes()
    file.write_bytes(data[:left] + bytes(byte ^ 0x55 for byte in data[left:]))
    with pytest.raises(Refused, match=r"cannot be read: .*ros2_0\.mcap"):
        tracks([tmp_path / "run"], Config(), topic="/slam", frames=None)
