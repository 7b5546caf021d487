"""The robot's model as URDF: its wheels in their places, and the configured frames.

The root is the frame of the odometry (``odometry.child_frame_id``). It lies on the floor midway
between the wheels (of a car: the rear ones), so the axles are one radius above it. The frame of the
inertial sensor has the axes of the base, and its place unless ``static_transforms`` configures
another. The sizes of the body and the width of a wheel are not configured: they follow from the
wheels, for display only.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple
from xml.etree import ElementTree

if TYPE_CHECKING:
    from collections.abc import Iterator

    from yahboomd.core.config import Config

WIDTH_PER_RADIUS = 0.8
"""A wheel's width per radius: a tyre of 65 mm diameter is 26 mm wide."""

BODY, FOOTPRINT = "base_link", "base_footprint"

Numbers = tuple[float, ...]


class UrdfWheel(NamedTuple):
    """A wheel: its names, the place of its axle, and its size, in metres.

    Attributes:
        name: The name of its motor, or of its place.
        joint: The joint, which turns if a motor drives it.
        x: Forward.
        y: To the left.
        driven: Whether a motor drives it, unlike the wheels that steer a car.
    """

    name: str
    joint: str
    x: float
    y: float
    radius_m: float
    width_m: float
    driven: bool = True


def wheels(config: Config) -> list[UrdfWheel]:
    """Every wheel, by its place from the base's middle, or from a car's rear axle."""
    chassis, length_m = config.chassis, _base_m(config)
    found: list[UrdfWheel] = []
    for side, names in config.motor_names().items():
        radius_m = config.radius_m(side)
        for number, name in enumerate(names):
            found.append(
                UrdfWheel(
                    name=name,
                    joint=config.joint_name(name),
                    x=0.0 if _steers(config) else _forward(side, number, len(names)) * length_m,
                    y=chassis.wheel_separation_m / (2.0 if "left" in side else -2.0),
                    radius_m=radius_m,
                    width_m=WIDTH_PER_RADIUS * radius_m,
                )
            )
    if _steers(config):
        # Nothing measures how far they turn or steer, so the model draws them straight.
        found += [
            each._replace(
                name=f"front_{each.name}",
                joint=f"front_{each.name}_wheel_joint",
                x=length_m,
                driven=False,
            )
            for each in found
        ]
    return found


def outer_radius_m(config: Config) -> float:
    """The radius of the circle around the base's middle that contains all of its wheels."""
    return max(
        math.hypot(abs(wheel.x) + wheel.radius_m, abs(wheel.y) + wheel.width_m / 2.0)
        for wheel in wheels(config)
    )


def urdf(config: Config) -> str:
    """The model as a URDF document; frames are without ``ros2.frame_prefix``."""
    robot = ElementTree.Element("robot", name=config.zenoh.namespace.replace("/", "_") or "robot")
    robot.append(
        ElementTree.Comment(
            " By `yahboomd config urdf`: the wheels are as configured; the sizes of the body and "
            "the width of the wheels are guesses for the eye. "
        )
    )
    root = config.odometry.child_frame_id
    placed = {transform.child for transform in config.ros2.static_transforms}
    body = BODY if root == FOOTPRINT and BODY not in placed else root
    _body(_link(robot, body), config)
    if body != root:
        _link(robot, root)
        _fixed(robot, root, body)
    if FOOTPRINT not in {root, *placed}:
        _link(robot, FOOTPRINT)
        _fixed(robot, root, FOOTPRINT)
    for wheel in wheels(config):
        _wheel(robot, body, wheel)
    if config.ros2.imu and config.imu.frame_id not in {*placed, root, body, FOOTPRINT}:
        _link(robot, config.imu.frame_id)
        _fixed(robot, root, config.imu.frame_id)
    for parent, child, xyz, rpy in _mounted(
        config, {link.get("name") for link in robot.iter("link")}
    ):
        _link(robot, child)
        _fixed(robot, parent, child, xyz, rpy)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _mounted(config: Config, known: set[str | None]) -> Iterator[tuple[str, str, Numbers, Numbers]]:
    """The frames of ``static_transforms`` that known links carry, directly or through others."""
    waiting = list(config.ros2.static_transforms)
    while ready := [each for each in waiting if each.parent in known]:
        waiting = [each for each in waiting if each not in ready]
        for each in ready:
            if each.child not in known:
                known.add(each.child)
                xyz, rpy = (each.x, each.y, each.z), (each.roll, each.pitch, each.yaw)
                yield each.parent, each.child, xyz, rpy


def _steers(config: Config) -> bool:
    return config.kinematics().least_radius_m > 0.0


def _forward(side: str, number: int, count: int) -> float:
    """The place of a wheel between the rear axle (-0.5) and the front one (0.5)."""
    if side.startswith(("front", "rear")):
        return 0.5 if side.startswith("front") else -0.5
    return 0.0 if count == 1 else 0.5 - number / (count - 1)


def _base_m(config: Config) -> float:
    # If the length of the base is not configured, it is drawn square.
    return config.chassis.wheel_base_m or config.chassis.wheel_separation_m


def _body(link: ElementTree.Element, config: Config) -> None:
    around = wheels(config)
    radius_m = max(wheel.radius_m for wheel in around)
    length_m = _base_m(config) + 2.0 * radius_m
    width_m = config.chassis.wheel_separation_m - max(wheel.width_m for wheel in around)
    size = (length_m, max(width_m, radius_m), radius_m)
    middle = (sum(wheel.x for wheel in around) / len(around), 0.0, 1.5 * radius_m)
    _shape(link, "box", {"size": _text(size)}, middle, colour="0.2 0.4 0.7 1")


def _wheel(robot: ElementTree.Element, body: str, wheel: UrdfWheel) -> None:
    link = _link(robot, f"{wheel.name}_wheel")
    size = {"radius": _text((wheel.radius_m,)), "length": _text((wheel.width_m,))}
    # A cylinder of URDF stands upright; the axle lies across the base.
    _shape(link, "cylinder", size, rpy=(math.pi / 2.0, 0.0, 0.0), colour="0.1 0.1 0.1 1")
    kind = "continuous" if wheel.driven else "fixed"
    joint = ElementTree.SubElement(robot, "joint", name=wheel.joint, type=kind)
    ElementTree.SubElement(joint, "parent", link=body)
    ElementTree.SubElement(joint, "child", link=f"{wheel.name}_wheel")
    _origin(joint, (wheel.x, wheel.y, wheel.radius_m))
    if wheel.driven:
        ElementTree.SubElement(joint, "axis", xyz="0 1 0")


def _link(robot: ElementTree.Element, name: str) -> ElementTree.Element:
    return ElementTree.SubElement(robot, "link", name=name)


def _fixed(
    robot: ElementTree.Element,
    parent: str,
    child: str,
    xyz: Numbers = (0.0, 0.0, 0.0),
    rpy: Numbers = (0.0, 0.0, 0.0),
) -> None:
    joint = ElementTree.SubElement(robot, "joint", name=f"{child}_joint", type="fixed")
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    _origin(joint, xyz, rpy)


def _shape(
    link: ElementTree.Element,
    shape: str,
    size: dict[str, str],
    xyz: Numbers = (0.0, 0.0, 0.0),
    rpy: Numbers = (0.0, 0.0, 0.0),
    *,
    colour: str,
) -> None:
    for purpose in ("visual", "collision"):
        part = ElementTree.SubElement(link, purpose)
        _origin(part, xyz, rpy)
        ElementTree.SubElement(ElementTree.SubElement(part, "geometry"), shape, size)
        if purpose == "visual":
            material = ElementTree.SubElement(part, "material", name=f"{shape}_colour")
            ElementTree.SubElement(material, "color", rgba=colour)


def _origin(element: ElementTree.Element, xyz: Numbers, rpy: Numbers = (0.0, 0.0, 0.0)) -> None:
    ElementTree.SubElement(element, "origin", xyz=_text(xyz), rpy=_text(rpy))


def _text(numbers: Numbers) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
