from __future__ import annotations

from xml.etree import ElementTree

import pytest

from yahboomd.core.config import Config
from yahboomd.tools.ros_files.robot_model import outer_radius_m, urdf

FOUR = {"preset": "4wd", "wheel_base_m": 0.2, "wheel_radius_m": 0.04}


def model(**sections) -> ElementTree.Element:
    return ElementTree.fromstring(urdf(Config.model_validate(sections)))


def numbers(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split()))


def joints(robot: ElementTree.Element, kind: str) -> dict[str, ElementTree.Element]:
    return {each.get("name"): each for each in robot.iter("joint") if each.get("type") == kind}


def placed(joint: ElementTree.Element) -> tuple[float, ...]:
    return numbers(joint.find("origin").get("xyz"))


def parents(robot: ElementTree.Element) -> dict[str, str]:
    return {
        joint.find("child").get("link"): joint.find("parent").get("link")
        for joint in robot.iter("joint")
    }


def test_the_articles_wheels_are_half_the_separation_to_each_side_and_one_radius_up() -> None:
    robot = model(chassis={"wheel_radius_m": 0.03, "wheel_separation_m": 0.2})
    wheels = joints(robot, "continuous")
    assert {name: placed(joint) for name, joint in wheels.items()} == {
        "left_wheel_joint": (0.0, 0.1, 0.03),
        "right_wheel_joint": (0.0, -0.1, 0.03),
    }
    assert {joint.find("axis").get("xyz") for joint in wheels.values()} == {"0 1 0"}
    assert {float(shape.get("radius")) for shape in robot.iter("cylinder")} == {0.03}


def test_the_frames_of_the_configuration_are_in_it_wherever_they_hang_on_the_base() -> None:
    frames = [
        {"parent": "mast", "child": "laser", "x": 0.1, "z": 0.2, "yaw": 3.0},
        {"parent": "base_link", "child": "mast", "z": 0.3},
        {"parent": "base_link", "child": "imu_link", "roll": 0.5},
        {"parent": "map", "child": "somewhere"},
        {"parent": "base_link", "child": "base_footprint", "z": -0.05},
    ]
    robot = model(ros2={"static_transforms": frames})
    found = parents(robot)
    assert (found["laser"], found["mast"], found["imu_link"]) == ("mast", "base_link", "base_link")
    assert "somewhere" not in found
    fixed = joints(robot, "fixed")
    assert placed(fixed["laser_joint"]) == (0.1, 0.0, 0.2)
    assert numbers(fixed["laser_joint"].find("origin").get("rpy")) == (0.0, 0.0, 3.0)
    assert placed(fixed["base_footprint_joint"]) == (0.0, 0.0, -0.05)


@pytest.mark.parametrize("root", ["base_link", "base_footprint", "chassis"])
def test_it_is_a_tree_each_link_once(root) -> None:
    frames = [{"parent": root, "child": "laser"}, {"parent": root, "child": "left_wheel"}]
    robot = model(odometry={"child_frame_id": root}, ros2={"static_transforms": frames})
    links = [link.get("name") for link in robot.iter("link")]
    assert len(set(links)) == len(links)
    assert set(links) - set(parents(robot)) == {root}
    assert set(parents(robot).values()) <= set(links)


def test_the_circle_of_the_wheels_holds_their_corners() -> None:
    config = Config.model_validate({"chassis": {**FOUR, "wheel_separation_m": 0.3}})
    # 0.1 to the axle and 0.04 to the rim; 0.15 to the wheel's middle and 0.016 to its side.
    assert outer_radius_m(config) == pytest.approx((0.14**2 + 0.166**2) ** 0.5)


def test_a_cars_origin_is_its_rear_axle_and_the_wheels_that_steer_are_fixed_in_front() -> None:
    chassis = {"preset": "ackermann", "wheel_base_m": 0.2, "wheel_radius_m": 0.03}
    robot = model(chassis=chassis)
    driven = joints(robot, "continuous")
    assert {name: placed(joint)[0] for name, joint in driven.items()} == {
        "left_wheel_joint": 0.0,
        "right_wheel_joint": 0.0,
    }
    fixed = joints(robot, "fixed")
    assert placed(fixed["front_left_wheel_joint"]) == (0.2, 0.075, 0.03)
    assert placed(fixed["front_right_wheel_joint"]) == (0.2, -0.075, 0.03)
    body = next(robot.iter("visual"))
    assert numbers(body.find("origin").get("xyz"))[0] == pytest.approx(0.1)
    assert outer_radius_m(Config.model_validate({"chassis": chassis})) == pytest.approx(
        (0.23**2 + 0.087**2) ** 0.5
    )


def test_the_inertial_sensors_frame_is_in_it_once_unless_it_is_switched_off() -> None:
    assert parents(model())["imu_link"] == "base_link"
    assert parents(model(imu={"frame_id": "gyro"}))["gyro"] == "base_link"
    assert "imu_link" not in parents(model(ros2={"imu": False}))
    frames = [{"parent": "base_link", "child": "imu_link", "z": 0.1}]
    robot = model(ros2={"static_transforms": frames})
    assert placed(joints(robot, "fixed")["imu_link_joint"]) == (0.0, 0.0, 0.1)
