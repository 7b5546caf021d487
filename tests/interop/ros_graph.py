"""Installed programs of ROS 2 around simulated robots, on the middleware that is chosen."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from real_robot import RealRobot
from ros_peers import HERE, Bridge, Peer, built, example_for, start_peer

NATIVE = os.environ.get("RMW_IMPLEMENTATION") == "rmw_zenoh_cpp"
WAY = "natively" if NATIVE else "bridge"
PYTHON = os.environ.get("YAHBOOMD_RMW_ZENOH_PYTHON") or "python3"
PREFIXES = [Path(each) for each in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
LASER = 'ros2.static_transforms=[{parent="base_link",child="laser",x=0.1}]'
FAR = "10000000,0,10000000,0"
"""Counters far from those after a reset, so that a delayed board loses no way."""
ROOM_M = (4.0, 3.0)
"""The size of the room in ros_world.py."""
BRINGUP = HERE.parents[1] / "extras/ros2/yahboomd_bringup"


def found(package: str, part: str) -> Path | None:
    """A file of an installed package."""
    parts = (each / part for each in PREFIXES if (each / "share" / package).is_dir())
    return next(filter(Path.exists, parts), None)


def installed(package: str, part: str) -> Path:
    """A file of an installed package, or a skip that names the package."""
    path = found(package, part)
    if path is None:
        pytest.skip(f"{package} is not installed: no {part} in AMENT_PREFIX_PATH")
    return path


def python(program: str) -> str:
    """What it prints in the interpreter of ROS 2; a skip if that lacks a module."""
    done = subprocess.run([PYTHON, "-c", program], check=False, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"{PYTHON}: {done.stderr[-300:]}")
    return done.stdout.strip()


def version(package: str) -> str:
    if found(package, f"share/{package}/package.xml") is None:
        return python(f"import importlib.metadata as m; print(m.version('{package}'))")
    text = installed(package, f"share/{package}/package.xml").read_text()
    written = re.search(r"<version>\s*([^<\s]+)", text)
    assert written
    return written[1]


@dataclass
class Graph:
    """A robot and the nodes around it, on one middleware."""

    folder: Path
    stack: ExitStack
    bridge: Bridge | None
    settings: list[str] = field(default_factory=list)
    environment: dict[str, str] = field(default_factory=dict)

    def robot(self, *settings: str, router: str = "") -> RealRobot:
        """The robot.

        Args:
            settings: More of its settings.
            router: The endpoint of the robot that is the router, if this one is not.
        """
        way = ["ros2.rmw_zenoh=true", "ros2.bridge=false"]
        way += [f'zenoh.connect=["{router}"]'] if router else []
        if self.bridge is not None:
            way = [f'zenoh.connect=["{self.bridge.endpoint}"]']
        self.settings = [part for each in (LASER, *settings, *way) for part in ("--set", each)]
        robot = RealRobot(self.folder, simulate=("--ticks", FAR), run=self.settings)
        self.stack.callback(robot.close)
        robot.daemon.says("Connected")
        self.environment = {"ROS_DOMAIN_ID": "0"}
        if self.bridge is not None:
            self.environment = {"ROS_DOMAIN_ID": str(self.bridge.domain)}
        else:
            override = f'connect/endpoints=["{router or robot.endpoint}"]'
            self.environment["ZENOH_CONFIG_OVERRIDE"] = override
        return robot

    def config(self, *words: str) -> str:
        """What `yahboomd config` prints of this robot."""
        asked = [sys.executable, "-m", "yahboomd", "config", *words, *self.settings]
        return subprocess.run(asked, check=True, capture_output=True, text=True).stdout

    def parameters(self, package: str) -> str:
        """The file that `yahboomd config parameters` prints."""
        path = self.folder / f"{package}.params.yaml"
        path.write_text(self.config("parameters", package))
        return str(path)

    def start(
        self, package: str, program: str, *remaps: str, files: Sequence[str] = (), **more: Any
    ) -> None:
        """A node, until the test ends.

        Args:
            package: Its package.
            program: Its program.
            remaps: Of names.
            files: Of parameters.
            more: Parameters that are in no file.
        """
        if more:
            path = self.folder / f"{program}.yaml"
            # JSON is YAML as well.
            path.write_text(json.dumps({"/**": {"ros__parameters": more}}))
            files = (*files, str(path))
        command = [str(installed(package, f"lib/{package}/{program}")), "--ros-args"]
        command += [part for each in remaps for part in ("-r", each)]
        command += [part for each in files for part in ("--params-file", each)]
        log = self.stack.enter_context((self.folder / f"{program}.log").open("w"))
        process = subprocess.Popen(
            command, env={**os.environ, **self.environment}, stdout=log, stderr=log
        )
        self.stack.callback(self.ended, process)

    def ros2(self, *words: str) -> str:
        """What a command of ros2cli prints, asked without its daemon."""
        python("import ros2cli")
        run = "import sys; from ros2cli.cli import main; sys.exit(main())"
        done = subprocess.run(
            [PYTHON, "-c", run, *words],
            env={**os.environ, **self.environment},
            check=False,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def ended(self, process: subprocess.Popen[bytes]) -> None:
        process.terminate()
        try:
            process.wait(10)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for log in self.folder.glob("*.log"):
            print(log.name, log.read_text()[-3000:])

    def launch(self, *arguments: str, config: Path, environment: dict[str, str]) -> None:
        """The bring-up of a robot, by ROS 2's own `launch`, until the test ends."""
        yahboomd = Path(sys.executable).with_name("yahboomd")
        file = BRINGUP / "launch/bringup.launch.py"
        given = [f"config:={config}", f"yahboomd:={yahboomd}", "way:=none", *arguments]
        peer = start_peer(
            [PYTHON, str(HERE / "launched.py"), str(file), *given],
            self.folder / "launch.log",
            {**environment, **self.environment},
        )
        # `launch` ends all of its nodes before itself.
        self.stack.callback(peer.close, 60.0)

    def world(self, namespace: str = "", **topics: str) -> Peer:
        """What is around the robot; it hears these topics, whose names lack their first slash."""
        heard = [f"/{topic.replace('__', '/')}={kind}" for topic, kind in topics.items()]
        settings = [f"{name}={value}" for name, value in self.environment.items()]
        command = ["env", *settings, PYTHON, str(HERE / "ros_world.py"), *heard]
        if namespace:
            remaps = (f"{name}:=/{namespace}{name}" for name in ("/odom", "/scan"))
            command += ["--ros-args", *(part for each in remaps for part in ("-r", each))]
        number = len(list(self.folder.glob("world*.log")))
        peer = start_peer(command, self.folder / f"world{number}.log")
        self.stack.callback(peer.close)
        return peer


@pytest.fixture
def graph(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Graph]:
    bridge = None if NATIVE else request.getfixturevalue("ros_bridge")
    with ExitStack() as stack:
        yield Graph(tmp_path, stack, bridge)


@pytest.fixture
def graphs(tmp_path: Path) -> Iterator[dict[str, Graph]]:
    """Of two robots, by name; what is heard of them, is in one graph."""
    with ExitStack() as stack:
        bridge = None
        if not NATIVE:
            config = example_for("bot.", tmp_path / "bridge.json5")
            log = tmp_path / "bridge.log"
            bridge = Bridge(built("bridge"), log, config=config, discovery="SUBNET")
            stack.callback(bridge.stop)
            bridge.start()
        folders = {name: tmp_path / name for name in ("bot1", "bot2")}
        for folder in folders.values():
            folder.mkdir()
        yield {name: Graph(folder, stack, bridge) for name, folder in folders.items()}


@pytest.fixture
def row(capsys: pytest.CaptureFixture[str]) -> Callable[[str, str], None]:
    """Prints what was seen of a package, as docs/bringup.md has it."""

    def tell(package: str, seen: str) -> None:
        with capsys.disabled():
            print(f"\n| {package} | {version(package)} | {WAY} | {seen} |")

    return tell


def command(world: Peer, topic: str, vx: float, wz: float = 0.0) -> None:
    """A Twist, twenty times a second."""
    fields = {"linear": {"x": vx}, "angular": {"z": wz}}
    world.order("publish", topic=topic, of="geometry_msgs/msg/Twist", hz=20, fields=fields)


def extent_m(drawn: dict[str, Any]) -> tuple[float, float]:
    """From the first to the last wall of a map, across and along."""
    walls = [
        (x, y) for y, line in enumerate(drawn["rows"]) for x, cell in enumerate(line) if cell == "#"
    ]
    if not walls:
        return 0.0, 0.0
    across, along = zip(*walls, strict=True)
    step = float(drawn["resolution"])
    return (max(across) - min(across)) * step, (max(along) - min(along)) * step
