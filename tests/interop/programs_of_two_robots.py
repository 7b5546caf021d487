"""Two robots in one graph, each with its own bring-up: `make ros-programs`, in a sourced ROS 2.

Started by the packages' own launch files, with slam_toolbox and what of Nav2 is installed. Each
test prints rows of the table in docs/bringup.md.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from real_robot import RealRobot, wait_for
from ros_graph import (
    BRINGUP,
    LASER,
    NATIVE,
    ROOM_M,
    Graph,
    command,
    extent_m,
    found,
    installed,
)

pytestmark = pytest.mark.realtime

NAV2 = {
    "nav2_controller": "controller_server",
    "nav2_velocity_smoother": "velocity_smoother",
    "nav2_planner": "planner_server",
    "nav2_collision_monitor": "collision_monitor",
}
"""What Nav2 needs to reach a place; without the last two its paths are straight and unguarded."""
MORE_OF_NAV2 = {
    "nav2_behaviors": "behavior_server",
    "nav2_bt_navigator": "bt_navigator",
    "nav2_route": "route_server",
    "nav2_smoother": "smoother_server",
    "nav2_waypoint_follower": "waypoint_follower",
    "opennav_docking": "opennav_docking",
    "nav2_lifecycle_manager": "lifecycle_manager",
}
"""What its launch file starts besides; the last one manages all others."""
CONTROLLERS = ("nav2_mppi_controller", "nav2_regulated_pure_pursuit_controller")
"""The one of Nav2's own file, and one that is taken if that is not installed."""
PATIENT_S = 3.0
"""How late a transform or a scan may be: a busy machine starves slam_toolbox for a second."""
SUCCEEDED = 4


@pytest.fixture
def prefix(tmp_path: Path) -> Path:
    """Of the bring-up, and sleepers in place of those of Nav2's programs that are not installed.

    The manager waits for each one, so it sleeps if another one does.
    """
    shared = tmp_path / "prefix/share"
    index = shared / "ament_index/resource_index/packages"
    index.mkdir(parents=True)
    missing = {
        n: p for n, p in {**NAV2, **MORE_OF_NAV2}.items() if found(n, f"lib/{n}/{p}") is None
    }
    if missing:
        missing["nav2_lifecycle_manager"] = MORE_OF_NAV2["nav2_lifecycle_manager"]
    for package, program in missing.items():
        sleeper = tmp_path / "prefix/lib" / package / program
        sleeper.parent.mkdir(parents=True)
        sleeper.write_text("#!/bin/sh\nexec sleep 3600\n")
        sleeper.chmod(0o755)
        (shared / package).mkdir()
        (index / package).touch()
    (shared / "yahboomd_bringup").symlink_to(BRINGUP)
    (index / "yahboomd_bringup").touch()
    return shared.parent


def bring_up(
    graphs: dict[str, Graph], prefix: Path, given: Sequence[str], *settings: str
) -> dict[str, RealRobot]:
    """Two robots, each with a lidar in a room, and its own bring-up."""
    installed("slam_toolbox", "lib/slam_toolbox/async_slam_toolbox_node")
    paths = (str(BRINGUP), os.environ.get("PYTHONPATH", ""))
    environment = {
        **os.environ,
        "AMENT_PREFIX_PATH": f"{prefix}:{os.environ['AMENT_PREFIX_PATH']}",
        "PYTHONPATH": ":".join(filter(None, paths)),
    }
    router, robots = "", {}
    for name, graph in graphs.items():
        robots[name] = graph.robot(f"zenoh.namespace={name}", *settings, router=router)
        if NATIVE:
            router = router or robots[name].endpoint
        config = graph.folder / "config.toml"
        config.write_text(f'zenoh.namespace = "{name}"\n{LASER}\n')
        lidar = graph.world(name)
        lidar.order("lidar", frame="laser", x=0.1)
        graph.launch("slam:=true", *given, config=config, environment=environment)
    return robots


def test_slam_toolbox_maps_for_one_of_two_robots(
    graphs: dict[str, Graph], prefix: Path, row: Callable[[str, str], None]
) -> None:
    robots = bring_up(graphs, prefix, [])
    maps = {f"{name}__map": "nav_msgs/msg/OccupancyGrid" for name in graphs}
    world = graphs["bot1"].world(**maps, bot2__tf="tf2_msgs/msg/TFMessage")
    # The other one has a map as well, of what it sees from where it stands.
    first = world.await_event(lambda e: e.get("topic") == "/bot2/map", "its map", 240.0)
    assert first["message"]["frame_id"] == "map"
    command(world, "/bot1/cmd_vel", 0.15, 0.3)
    wait_for(lambda: robots["bot1"].travelled_m() > 6.0, "the robot to drive around", 240.0)

    def whole() -> bool:
        found_m = extent_m(world.message("/bot1/map"))
        return all(abs(each - real) < 0.15 for each, real in zip(found_m, ROOM_M, strict=True))

    wait_for(whole, "a map of the room's size", 240.0)
    world.events.clear()
    for frame in ("odom", "base_link"):
        (at,) = world.message("/bot2/tf", lambda m, f=frame: child(m) == f)["transforms"]
        place = at["transform"]["translation"]
        assert math.hypot(place["x"], place["y"]) < 0.1
    world.order("rest", topic="/bot1/cmd_vel")
    robots["bot1"].settled_truth()
    assert robots["bot2"].travelled_m() == 0.0
    row(
        "slam_toolbox",
        "with the launch files of two robots in one graph: a map of the room for the one that "
        "drives, and the other one stays where it stands",
    )


def child(transforms: dict[str, Any]) -> str:
    return str(transforms["transforms"][0]["child_frame_id"])


def test_nav2_drives_two_robots(
    graphs: dict[str, Graph], prefix: Path, row: Callable[[str, str], None]
) -> None:
    """Each has its own bring-up with slam_toolbox, in the launch files of the packages."""
    installed("nav2_bringup", "share/nav2_bringup/package.xml")
    nodes = [each for each in NAV2 if not (prefix / "lib" / each).exists()]
    for package in list(NAV2)[:2]:
        installed(package, f"lib/{package}/{NAV2[package]}")
    given = ["navigation:=true", "robot_radius:=0.15"]
    first, other = CONTROLLERS
    controller = first if found(first, f"share/{first}/package.xml") else other
    follow = {"transform_tolerance": PATIENT_S}
    if controller == other:
        follow["plugin"] = f"{other}::RegulatedPurePursuitController"
    costmap = {"ros__parameters": {"transform_tolerance": PATIENT_S}}
    mine = {
        "controller_server": {"ros__parameters": {"FollowPath": follow}},
        "local_costmap": {"local_costmap": costmap},
        "global_costmap": {"global_costmap": costmap},
        "collision_monitor": {
            "ros__parameters": {"transform_tolerance": PATIENT_S, "source_timeout": PATIENT_S}
        },
    }
    (prefix / "mine.yaml").write_text(json.dumps(mine))
    given.append(f"nav2_params:={prefix / 'mine.yaml'}")
    settings = []
    if "nav2_collision_monitor" not in nodes:
        settings.append("command.sources.cmd_vel_smoothed.priority=10")
    robots = bring_up(graphs, prefix, given, *settings)
    operator = graphs["bot1"].world()
    if (prefix / "lib/nav2_lifecycle_manager").exists():
        for node in [f"{name}/{NAV2[each]}" for name in robots for each in nodes]:
            operator.order("activate", node=node, patience_s=240.0)
            operator.await_event(lambda e, n=node: e == {"event": "active", "node": n}, node, 300.0)
    ended_m = []
    for name, x, y in (("bot1", 1.5, 0.2), ("bot2", -0.9, 0.9), ("bot1", 0.0, 1.0)):
        (stands,) = (robots[each] for each in robots if each != name)
        before_m = stands.travelled_m()
        truth = robots[name].settled_truth()
        start = None if "nav2_planner" in nodes else [truth.x, truth.y]
        operator.order("drive_to", robot=name, x=x, y=y, start=start)
        ended = operator.await_event(lambda e: e["event"] == "arrived", "the end", 240.0)
        assert ended["status"] == SUCCEEDED, ended
        assert math.dist(ended["path"][-1], (x, y)) < 0.1
        print(name, "gave up with", ended["errors"])
        truth = robots[name].settled_truth()
        ended_m.append(math.dist((truth.x, truth.y), (x, y)))
        # The goal checker's tolerance, and what the map is off.
        assert ended_m[-1] < 0.35
        assert stands.travelled_m() == before_m
    for package in (*nodes, controller):
        row(
            package,
            "with the launch files and generated parameters of two robots in one graph: each is "
            f"driven on {'planned' if 'nav2_planner' in nodes else 'straight'} paths, to "
            + ", ".join(f"{1000.0 * each:.0f} mm" for each in ended_m)
            + " from its goals, while the other one stands",
        )
