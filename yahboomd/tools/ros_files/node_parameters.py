"""Parameters of ROS 2 nodes that follow from the configuration: frames, topics, speeds, types.

They hold only the facts of the base, and are laid over the nodes' own parameter files. Plugins,
critics and costmaps stay there, because they differ between distributions. Nav2 is tuned for a
speed, so it gets the smaller of its own and the base's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from yahboomd.tools.ros_files.robot_model import outer_radius_m

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from yahboomd.core.config import Config
    from yahboomd.core.config.driving import AxisLimits

Tree = dict[str, "Tree | float | int | bool | str | list[float] | list[bool]"]

NAV2_LINEAR = {"velocity": 0.5, "acceleration": 2.5, "deceleration": 2.5}
"""m/s and m/s^2 in Nav2's own parameters, which reverse slower than they drive."""

NAV2_ANGULAR = {"velocity": 1.9, "acceleration": 3.2, "deceleration": 3.2}
NAV2_REVERSE_M_S = 0.35
NAV2_RECOVERY_RAD_S = (0.4, 1.0)
NAV2_DOCKING_M_S = 0.15

OLDER_NAV2 = {"humble", "iron"}
"""The distributions whose Nav2 drives with DWB and knows no TwistStamped."""

MARGIN_M = 0.02
"""Added to the circle around the wheels, because the body's size is not configured."""

STICK = {"x": 1, "y": 0, "yaw": 3}
"""Axes of a pad in SDL's numbers: the left stick drives, the right one turns."""

ENABLE_BUTTON, TURBO_BUTTON = 4, 5
"""The shoulder buttons, left and right."""

NORMAL_SHARE = 0.5
"""The share of the base's greatest speed without the turbo button."""


def nav2(config: Config) -> Tree:
    """Parameters to lay over ``nav2_params.yaml`` of the distribution's nav2_bringup."""
    (odom, base), room = _frames(config), _map(config)
    older = config.ros2.distro in OLDER_NAV2
    holonomic = config.kinematics().holonomic
    speeds = _speeds(config.limits.linear, NAV2_LINEAR)
    turns = _speeds(config.limits.angular, NAV2_ANGULAR)
    sideways = 1.0 if holonomic else 0.0
    slow, fast = (min(each, turns["velocity"]) for each in NAV2_RECOVERY_RAD_S)
    crawl = min(NAV2_DOCKING_M_S, speeds["velocity"])
    radius = {"robot_radius": round(outer_radius_m(config) + MARGIN_M, 3)}
    topic = {"odom_topic": config.ros2.odom_topic}
    stamped: Tree = {}
    if not older:
        stamped = {"enable_stamped_cmd_vel": navigation_source(config) in _stamped(config)}

    def triple(key: str, sign: float = 1.0) -> list[float]:
        return [sign * speeds[key], sign * sideways * speeds[key], sign * turns[key]]

    amcl: Tree = {"base_frame_id": base, "odom_frame_id": odom, "global_frame_id": room}
    if holonomic:
        amcl["robot_model_type"] = "nav2_amcl::OmniMotionModel"
    if older:
        follow = _dwb(speeds, turns, sideways)
    else:
        least_m = config.kinematics().least_radius_m
        follow = _mppi(speeds, turns, holonomic=holonomic, least_radius_m=least_m)
    frames: Tree = {"global_frame": room, "local_frame": odom}
    recoveries: Tree = {
        **({"global_frame": odom} if config.ros2.distro == "humble" else frames),
        "robot_base_frame": base,
        "min_rotational_vel": slow,
        "max_rotational_vel": fast,
        "rotational_acc_lim": turns["acceleration"],
        **stamped,
    }
    smoother: Tree = {
        "max_velocity": triple("velocity"),
        "min_velocity": triple("velocity", -1.0),
        "max_accel": triple("acceleration"),
        "max_decel": triple("deceleration", -1.0),
        **topic,
        **stamped,
    }
    nodes: dict[str, Tree] = {
        "amcl": amcl,
        "bt_navigator": {"global_frame": room, "robot_base_frame": base, **topic},
        "controller_server": {**topic, **stamped, "FollowPath": follow},
        "behavior_server": recoveries,
        "velocity_smoother": smoother,
    }
    if not older:
        nodes["collision_monitor"] = {"base_frame_id": base, "odom_frame_id": odom, **stamped}
        nodes["docking_server"] = {
            "base_frame": base,
            "fixed_frame": odom,
            "controller": {"v_linear_min": crawl, "v_linear_max": crawl},
            **stamped,
        }
    tree = _parameters(nodes)
    local: Tree = {"global_frame": odom, "robot_base_frame": base, **radius}
    tree["local_costmap"] = _parameters({"local_costmap": local})
    wide: Tree = {"global_frame": room, "robot_base_frame": base, **radius}
    tree["global_costmap"] = _parameters({"global_costmap": wide})
    return tree


def slam_toolbox(config: Config) -> Tree:
    """Parameters to lay over ``mapper_params_online_async.yaml`` of slam_toolbox."""
    odom, base = _frames(config)
    frames: Tree = {"map_frame": _map(config), "odom_frame": odom, "base_frame": base}
    # Its default has a slash in front, and leaves the namespace.
    return _parameters({"slam_toolbox": {**frames, "map_name": "map"}})


def robot_localization(config: Config) -> Tree:
    """Parameters of robot_localization's EKF for the wheels' odometry."""
    odom, base = _frames(config)
    # Rows: position, angles, velocity, turning, acceleration. The wheels measure vx, vy and the
    # turn rate; on a base that cannot move sideways vy is known to be zero.
    measured = [False] * 6 + [True, True, False] + [False, False, True] + [False] * 3
    return _parameters(
        {
            "ekf_filter_node": {
                "frequency": config.odometry.publish_rate_hz,
                "two_d_mode": True,
                "publish_tf": True,
                "map_frame": _map(config),
                "odom_frame": odom,
                "base_link_frame": base,
                "world_frame": odom,
                "odom0": config.ros2.odom_topic,
                "odom0_config": [*measured],
            }
        }
    )


def joystick(config: Config) -> Tree:
    """Parameters of joy and teleop_twist_joy to drive the base with a pad and a deadman button."""
    _, base = _frames(config)
    limits, holonomic = config.limits, config.kinematics().holonomic
    speed, turn = limits.linear.velocity or 0.0, limits.angular.velocity or 0.0
    linear: Tree = {"x": STICK["x"], **({"y": STICK["y"]} if holonomic else {})}
    teleop: Tree = {
        "require_enable_button": True,
        "enable_button": ENABLE_BUTTON,
        "enable_turbo_button": TURBO_BUTTON,
        "axis_linear": linear,
        "axis_angular": {"yaw": STICK["yaw"]},
        "scale_linear": dict.fromkeys(linear, NORMAL_SHARE * speed),
        "scale_linear_turbo": dict.fromkeys(linear, speed),
        "scale_angular": {"yaw": NORMAL_SHARE * turn},
        "scale_angular_turbo": {"yaw": turn},
    }
    if config.ros2.distro not in OLDER_NAV2:
        stamped = joystick_source(config) in _stamped(config)
        teleop |= {"publish_stamped_twist": stamped, "frame": base}
    pad: Tree = {"deadzone": 0.1, "autorepeat_rate": 20.0}
    return _parameters({"joy_node": pad, "teleop_twist_joy_node": teleop})


PARAMETERS: Mapping[str, Callable[[Config], Tree]] = {
    "nav2": nav2,
    "slam_toolbox": slam_toolbox,
    "robot_localization": robot_localization,
    "joystick": joystick,
}
"""Makes the parameters of ``config parameters NAME``, by the package of the nodes."""


def navigation_source(config: Config) -> str:
    """The key for a program's commands: ``cmd_vel``, or the key of the least priority."""
    sources = config.command.sources
    return "cmd_vel" if "cmd_vel" in sources else min(sources, key=lambda s: sources[s].priority)


def joystick_source(config: Config) -> str:
    """The key for a person's commands: the one of the greatest priority."""
    sources = config.command.sources
    return max(sources, key=lambda name: sources[name].priority)


def _dwb(speeds: Mapping[str, float], turns: Mapping[str, float], sideways: float) -> Tree:
    return {
        "max_vel_x": speeds["velocity"],
        "min_vel_y": -sideways * speeds["velocity"],
        "max_vel_y": sideways * speeds["velocity"],
        "max_vel_theta": turns["velocity"],
        "max_speed_xy": speeds["velocity"],
        "acc_lim_x": speeds["acceleration"],
        "acc_lim_y": sideways * speeds["acceleration"],
        "acc_lim_theta": turns["acceleration"],
        "decel_lim_x": -speeds["deceleration"],
        "decel_lim_y": -sideways * speeds["deceleration"],
        "decel_lim_theta": -turns["deceleration"],
    }


def _mppi(
    speeds: Mapping[str, float],
    turns: Mapping[str, float],
    *,
    holonomic: bool,
    least_radius_m: float,
) -> Tree:
    forward: Tree = {
        "vx_max": speeds["velocity"],
        "vx_min": -min(NAV2_REVERSE_M_S, speeds["velocity"]),
        "wz_max": turns["velocity"],
        "ax_max": speeds["acceleration"],
        "ax_min": -speeds["deceleration"],
        "az_max": turns["acceleration"],
    }
    if least_radius_m > 0.0:
        return forward | {
            "motion_model": "Ackermann",
            "AckermannConstraints": {"min_turning_r": round(least_radius_m + 0.0005, 3)},
        }
    if not holonomic:
        return forward
    return forward | {
        "motion_model": "Omni",
        "vy_max": speeds["velocity"],
        "ay_max": speeds["acceleration"],
        "ay_min": -speeds["deceleration"],
    }


def _speeds(limits: AxisLimits, tuned: Mapping[str, float]) -> dict[str, float]:
    return {key: min(value, getattr(limits, key) or value) for key, value in tuned.items()}


def _frames(config: Config) -> tuple[str, str]:
    prefix, odometry = config.ros2.frame_prefix, config.odometry
    return prefix + odometry.frame_id, prefix + odometry.child_frame_id


def _map(config: Config) -> str:
    return f"{config.ros2.frame_prefix}map"


def _stamped(config: Config) -> tuple[str, ...]:
    return config.ros2.stamped_commands


def _parameters(nodes: Mapping[str, Tree]) -> Tree:
    return {name: {"ros__parameters": parameters} for name, parameters in nodes.items()}
