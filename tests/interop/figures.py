"""The figures of docs/ros2.md: `make interop-figures` measures and prints them (15 minutes).

Real nodes of ROS 2 on FastDDS, the real bridge with the example's configuration, the daemon and a
simulated board, all on one machine.

A latency of a topic is the time from the board's reading, which is the message's stamp, to the
callback in the node, the board's line included. That of a command is the time from `publish` to the
frame at the board's port. Losses are relative to the samples that a Zenoh subscriber at the
daemon's own port received.
"""

import json
import re
import struct
import time
from contextlib import closing

import pytest
import zenoh
from real_robot import Client, RealRobot
from ros_peers import DISTROS, until

from benchmarks.latency import UNLIMITED
from benchmarks.results import median, quantile
from benchmarks.rig import share_of_core, usage
from yahboomd.simulation.heard import read_heard

pytestmark = [pytest.mark.realtime, pytest.mark.timeout(1800)]

COMMANDS = 600
LATE = 10
LIVES = 33
SPEED = re.compile(r"\$spd:(-?\d+),")


def spread(values_ns):
    return " | ".join(f"{quantile(values_ns, share) / 1e6:.1f}" for share in (0.5, 0.95, 0.99))


def show(capsys, *rows):
    with capsys.disabled():
        print(*rows, sep="\n", flush=True)


@pytest.fixture
def observed(tmp_path, ros_bridge):
    """A robot whose board notes its commands; every command becomes one frame."""
    run = [f'zenoh.connect=["{ros_bridge.endpoint}"]', *UNLIMITED]
    driven = RealRobot(
        tmp_path,
        simulate=("--heard", str(tmp_path / "heard")),
        run=[part for each in run for part in ("--set", each)],
    )
    driven.daemon.says("Connected")
    yield driven
    driven.close()


@pytest.mark.parametrize("distro", DISTROS)
def test_latencies_and_losses(observed, start_ros_node, tmp_path, capsys, distro):
    consumers = ("rviz", "nav2", "robot_localization", "tf2_ros", "robot_state_publisher")
    node = start_ros_node(*consumers, distro=distro)
    for topic in ("/odom", "/tf", "/joint_states"):
        node.message(topic)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([observed.endpoint]))
    published = []

    def note(sample):
        sec, nanosec = struct.unpack_from("<iI", sample.payload.to_bytes(), 4)
        published.append(sec * 1_000_000_000 + nanosec)

    with zenoh.open(config) as session:
        session.declare_subscriber("odom", note)
        until(lambda: published, "odometry")
        node.order("measure")
        node.await_event(lambda e: e["event"] == "measuring", "the start")
        node.order("ramp", count=COMMANDS)
        node.await_event(lambda e: e["event"] == "ramped", "the end", 120.0)
        node.order("measured")
        noted = node.await_event(lambda e: e["event"] == "measured", "the figures")
    rows = []
    for name, arrivals in noted["arrivals"].items():
        topic, consumer = name.split()
        if topic == "/tf_static":
            continue
        stamps = {stamp for stamp, _ in arrivals}
        due = [each for each in published if min(stamps) <= each <= max(stamps)]
        lost = len(set(due) - stamps)
        rate_hz = (len(arrivals) - 1) / (arrivals[-1][1] - arrivals[0][1]) * 1e9
        late = spread([heard - stamp for stamp, heard in arrivals])
        twice = len(arrivals) - len(stamps)
        rows.append(
            f"| {distro} | `{topic}` as {consumer} | {rate_hz:.1f} | {late} | {lost} of {len(due)}"
            f" | {twice} twice"
        )
    wire = [
        (each.t_ns, int(match[1]))
        for each in read_heard(tmp_path / "heard")
        for match in SPEED.finditer(each.data)
    ]
    taken = []
    for sent_ns, vx in noted["commands"]:
        units = round(vx * 1000 - 0.4)
        at_ns = next((t for t, left in wire if t >= sent_ns and left == units), None)
        if at_ns is not None and at_ns - sent_ns < 1_000_000_000:
            taken.append(at_ns - sent_ns)
    missed = len(noted["commands"]) - len(taken)
    rows.append(f"| {distro} | `/cmd_vel` to the wire | 20 | {spread(taken)} | {missed} missed")
    show(capsys, "", *rows)
    assert missed < COMMANDS / 10


@pytest.mark.parametrize("distro", DISTROS)
def test_late_joiners(observed, start_ros_node, capsys, distro):
    waits = []
    for _ in range(LATE):
        node = start_ros_node("rviz", distro=distro)
        began_ns = time.monotonic_ns()
        node.message("/odom")
        waits.append(time.monotonic_ns() - began_ns)
        node.close()
    show(capsys, f"{distro}: first /odom after, ms: {[round(each / 1e6) for each in waits]}")


def test_lives(ros_bridge, start_ros_node, robot, capsys):
    driven = robot(ros_bridge.endpoint)
    for life in range(1, LIVES + 1):
        node = start_ros_node()
        node.message("/estopped", lambda m: not m["data"])
        with closing(Client("client", driven.endpoint)) as watcher:
            node.order("drive", vx=0.2, hz=20)
            began_s = time.monotonic()
            node.message("/odom", lambda m: m["twist"]["twist"]["linear"]["x"] > 0.15, "driving")
            drives_s = time.monotonic() - began_s
            first = watcher.latest("status")
            last = until(
                lambda watcher=watcher, first=first: (
                    watcher.latest("status")["stamp_ns"] > first["stamp_ns"] + 2_000_000_000
                    and watcher.latest("status")
                ),
                "two seconds",
            )
            passed_s = (last["stamp_ns"] - first["stamp_ns"]) / 1e9
            received = last["command"]["received"] - first["command"]["received"]
            node.order("press", data=True)
            node.message("/estopped", lambda m: m["data"], "the emergency stop")
            refused = watcher.ask("yahboomd/estop/reset")
            node.order("rest")
            until(lambda: watcher.ask("yahboomd/estop/reset")["success"], "the release")
        command = last["command"]
        show(
            capsys,
            f"life {life}: {received / passed_s:.0f} Hz; drives after {drives_s:.2f} s;"
            f" refused {command['refused']}, revoked {first['command']['revoked']}, after that"
            f" {command['revoked'] - first['command']['revoked']}; {last['state']}",
        )
        assert not refused["success"]
        assert last["state"] == "driving"
        node.close()
        assert driven.daemon.end() == 0
        if life < LIVES:
            driven.start_daemon().says("Connected")


TOPICS = {
    "all topics": (),
    "without /odom": ("ros2.odom=false",),
    "without /tf": ("ros2.publish_tf=false",),
    "without /joint_states": ("ros2.joint_states=false",),
    "without /battery_state": ("ros2.battery_state=false",),
    "without /diagnostics": ("ros2.diagnostics=false",),
    "/odom alone": tuple(
        f"ros2.{topic}=false"
        for topic in ("publish_tf", "joint_states", "battery_state", "diagnostics")
    ),
    "at 20 Hz": ("odometry.publish_rate_hz=20",),
}
WITH_SENSOR = {"all topics": (), "without /imu/data, /imu/data_raw": ("ros2.imu=false",)}
READERS = {
    "no node": (),
    "all topics": ("rviz", "tf2_ros", "robot_state_publisher", "panel", "imu"),
}


@pytest.mark.parametrize(("dialect", "topics"), [("streamed", TOPICS), ("rosmaster", WITH_SENSOR)])
def test_costs_by_topic(ros_bridge, start_ros_node, robot, capsys, dialect, topics):
    """CPU of daemon and bridge, % of a core, in three rounds; and what each topic costs of it."""
    shares = {}
    for readers, consumers in READERS.items():
        if consumers:
            start_ros_node(*consumers)
        for _ in range(3):
            for name, settings in topics.items():
                driven = robot(ros_bridge.endpoint, *settings, dialect=dialect)
                pids = driven.daemon.process.pid, ros_bridge.process.pid
                time.sleep(1.0)
                before = [usage(pid) for pid in pids]
                time.sleep(5.0)
                pairs = zip(before, (usage(pid) for pid in pids), strict=True)
                figures = [100.0 * share_of_core(*pair) for pair in pairs]
                shares.setdefault((readers, name), []).append(figures)
                driven.close()
    show(capsys, "read by | published | daemon, % | bridge, % | both, times all topics")
    for (readers, name), found in shares.items():
        daemon, bridge = (median(column) for column in zip(*found, strict=True))
        whole = zip(found, shares[readers, "all topics"], strict=True)
        ratio = median([sum(part) / sum(of) for part, of in whole])
        show(capsys, f"{readers} | {name} | {daemon:.1f} | {bridge:.1f} | {ratio:.2f}")
