"""The robot's machine and another one, as network namespaces with a cable between them.

Each has its own loopback, interface, ports and multicast; the processes are the real ones. What
docs/ros2.md advises for one machine and for two is tried here.
"""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack

import pytest
from ros_peers import DISTROS, EXAMPLE, built, ros_node, start_peer, until
from zenoh_fixtures import free_endpoint

pytestmark = [pytest.mark.realtime, pytest.mark.nightly]

ROBOT, LAPTOP = "10.77.0.1", "10.77.0.2"
DOMAIN = 0
ON_LOOPBACK = (
    "CYCLONEDDS_URI=<CycloneDDS><Domain><General><Interfaces>"
    '<NetworkInterface name="lo"/></Interfaces></General></Domain></CycloneDDS>'
)
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
NODES = {
    "no setting": (),
    "range": (f"{RANGE}=LOCALHOST",),
    "older": ("ROS_LOCALHOST_ONLY=1",),
    "peer": (f"{RANGE}=LOCALHOST", f"ROS_STATIC_PEERS={ROBOT}"),
}
UNFOUND_S = 5.0
"""Discovery takes one second here; after this time it has failed."""


def ip(*arguments):
    return subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)


class Machines:
    """Two namespaces and what runs in them."""

    def __init__(self, folder, stack):
        if shutil.which("ip") is None:
            pytest.skip("no network namespaces here: there is no `ip` (Debian: iproute2)")
        self.folder, self.stack = folder, stack
        self.names = {"robot": f"robot-{os.getpid()}", "laptop": f"laptop-{os.getpid()}"}
        for name in self.names.values():
            made = ip("netns", "add", name)
            if made.returncode:
                pytest.skip(f"no network namespaces here: {made.stderr.strip()}")
            stack.callback(ip, "netns", "del", name)
        robot, laptop = self.names.values()
        cable = ("link", "add", "eth0", "type", "veth", "peer", "name", "eth0", "netns", laptop)
        laid = ip("-n", robot, *cable)
        if laid.returncode:
            pytest.skip(f"no virtual cables here: {laid.stderr.strip()}")
        for name, address in ((robot, ROBOT), (laptop, LAPTOP)):
            for command in (
                ("addr", "add", f"{address}/24", "dev", "eth0"),
                ("link", "set", "lo", "up"),
                ("link", "set", "eth0", "up"),
                ("route", "add", "default", "dev", "eth0"),
            ):
                assert ip("-n", name, *command).returncode == 0, command

    def within(self, machine, *settings):
        return ["ip", "netns", "exec", self.names[machine], "env", *settings]

    def start(self, machine, *command, settings=()):
        log = (self.folder / f"{machine}-{len(list(self.folder.iterdir()))}.log").open("w")
        process = subprocess.Popen(
            [*self.within(machine, *settings), *map(str, command)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )

        def end():
            process.send_signal(signal.SIGINT)
            try:
                process.wait(60)
            finally:
                process.kill()
                process.wait()
                log.close()

        self.stack.callback(end)

    def start_robot(self, *settings):
        """A simulated board, and the daemon with settings such as ``zenoh.connect=[...]``."""
        board = self.folder / "board"
        daemon = (sys.executable, "-m", "yahboomd")
        self.start("robot", *daemon, "simulate", "--link", board)
        latch = f"estop.latch_file={self.folder / 'estop'}"
        listen = f'zenoh.listen=["{free_endpoint()}"]'
        run = [part for each in (listen, latch, *settings) for part in ("--set", each)]
        self.start("robot", *daemon, "run", "--port", board, *run)

    def start_bridge(self, machine, *settings, config=EXAMPLE):
        distro = ("ROS_DISTRO=jazzy", f"ROS_DOMAIN_ID={DOMAIN}")
        self.start(machine, built("bridge"), config, settings=(*distro, *settings))

    def start_node(self, machine, *settings, distro="jazzy", domain=DOMAIN):
        name = f"node-{len(list(self.folder.iterdir()))}.log"
        command = [*self.within(machine, *settings), *ros_node(distro, domain)]
        node = start_peer(command, self.folder / name)
        self.stack.callback(node.close)
        return node

    def finders(self, wanted, nodes=NODES):
        """Which nodes hear the robot, as (machine, setting)."""
        started = {
            (machine, setting): self.start_node(machine, *nodes[setting])
            for machine in self.names
            for setting in nodes
        }
        for each in wanted:
            started[each].message("/estopped", what=f"{each} to hear the robot")
        found = set(wanted)
        for each, node in started.items():
            if each not in wanted:
                with node.news:
                    node.news.wait_for(
                        lambda events=node.events: heard(events), UNFOUND_S / len(started)
                    )
                if heard(node.events):
                    found.add(each)
        for node in started.values():
            node.process.stdin.close()  # they end side by side
        return found


def heard(events):
    return any(event["event"] == "message" for event in events)


@pytest.fixture
def machines(tmp_path):
    with ExitStack() as stack:
        yield Machines(tmp_path, stack)


def of(machine, *settings):
    return {(machine, setting) for setting in settings}


LONG = pytest.mark.skipif(
    not os.environ.get("YAHBOOMD_INTEROP"), reason="`make interop-figures` runs it"
)


@pytest.mark.parametrize(
    ("bridge", "finders"),
    [
        ((), of("robot", "no setting", "peer") | of("laptop", "no setting", "peer")),
        ((ON_LOOPBACK,), of("robot", *NODES)),
        pytest.param(
            (f"{RANGE}=LOCALHOST",), of("robot", "peer") | of("laptop", "peer"), marks=LONG
        ),
        pytest.param(
            (ON_LOOPBACK, f"{RANGE}=LOCALHOST"), of("robot", "range", "older", "peer"), marks=LONG
        ),
    ],
    ids=["no setting", "loopback", "range", "loopback and range"],
)
def test_who_finds_the_bridge_of_the_example(machines, bridge, finders):
    machines.start_bridge("robot", *bridge)
    machines.start_robot()
    assert machines.finders(finders) == finders


def drives_and_stops(node):
    node.message("/estopped", lambda m: not m["data"])
    node.order("drive", vx=0.2, hz=20)
    node.message("/odom", lambda m: m["twist"]["twist"]["linear"]["x"] > 0.15, "it to drive")

    def stopped():
        # DDS may lose samples that are published before the reader knows its writer as well.
        node.order("press", data=True)
        heard = [event for event in list(node.events) if event.get("topic") == "/estopped"]
        return any(event["message"]["data"] for event in heard)

    until(stopped, "the emergency stop")


@pytest.mark.parametrize("distro", DISTROS)
def test_a_node_of_another_machine_drives_and_stops_the_robot(machines, distro):
    machines.start_bridge("robot")
    machines.start_robot()
    drives_and_stops(machines.start_node("laptop", distro=distro))


def test_the_bridge_may_run_on_the_other_machine_and_is_reached_by_its_address(machines, tmp_path):
    config = tmp_path / "bridge.json5"
    config.write_text(EXAMPLE.read_text().replace("tcp/127.0.0.1:7447", f"tcp/{LAPTOP}:7447"))
    machines.start_bridge("laptop", ON_LOOPBACK, config=config)
    machines.start_robot(f'zenoh.connect=["tcp/{LAPTOP}:7447"]')
    nodes = {"no setting": NODES["no setting"]}
    assert machines.finders(of("laptop", "no setting"), nodes) == of("laptop", "no setting")
    drives_and_stops(machines.start_node("laptop"))


def test_a_node_of_another_domain_finds_nothing(machines):
    machines.start_bridge("robot")
    machines.start_robot()
    machines.start_node("laptop").message("/estopped")
    other = machines.start_node("laptop", domain=DOMAIN + 1)
    with other.news:
        assert not other.news.wait_for(lambda: heard(other.events), UNFOUND_S)
