"""Access on a real robot: the examples, with certificates and passwords made here."""

from __future__ import annotations

import contextlib
import json
import resource
import socket
import ssl
import struct
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zenoh
from real_robot import Process, RealRobot, free_endpoint, wait_for

from yahboomd.cli.main import main
from yahboomd.client import NoDaemon, Robot
from yahboomd.core.messages import cdr
from yahboomd.ros2.messages import ros2_names

pytestmark = pytest.mark.realtime

FLOOD = Path(__file__).parents[1] / "plugins" / "zenoh_flood_process.py"

HERE = {
    "    subjects: [\n": '{ id: "here", interfaces: ["lo"] },',
    "    policies: [\n": '{ subjects: ["here"], '
    'rules: ["out", "watch", "stop", "drive", "hold moves", "serve moves", "services"] },',
}
"""The addition of docs/security.md for the programs of this machine."""

PASSWORDS = {"operator": "first", "viewer": "second", "stranger": "third", "moves": "fourth"}


def mutual(example: Callable[..., str], authority: Any) -> str:
    """The example in which both sides show certificates."""
    return example(
        "zenoh-mtls.json5",
        ca_pem=authority.path("ca.pem"),
        robot_pem=authority.path("robot.pem"),
        robot_key=authority.path("robot.key"),
    )


@pytest.fixture(params=[pytest.param("users", marks=pytest.mark.nightly), "certificates"])
def house(
    request: pytest.FixtureRequest,
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    authority: Any,
    tmp_path: Path,
) -> tuple[RealRobot, Callable[[str], dict[str, Any]]]:
    """A guarded robot, and the papers of each name."""
    if request.param == "certificates":
        return guarded(mutual(example, authority), "tls"), authority.shown_by

    users = tmp_path / "users"
    users.write_text("".join(f"{name}:{word}\n" for name, word in PASSWORDS.items()))
    text = example(
        "zenoh-acl.json5",
        users=str(users),
        robot_pem=authority.path("robot.pem"),
        robot_key=authority.path("robot.key"),
    )

    def papers(name: str) -> dict[str, Any]:
        return {
            "transport/link/tls/root_ca_certificate": authority.path("ca.pem"),
            "transport/auth/usrpwd/user": name,
            "transport/auth/usrpwd/password": PASSWORDS[name],
        }

    return guarded(text, "tls"), papers


def zenoh_file(folder: Path, name: str, papers: dict[str, Any]) -> Path:
    """A client's own file of Zenoh."""
    config = zenoh.Config()
    for key, value in papers.items():
        config.insert_json5(key, json.dumps(value))
    file = folder / f"{name}.json5"
    file.write_text(str(config))
    return file


@pytest.mark.nightly
def test_an_operator_has_moves_driven_and_a_viewer_neither_starts_them_nor_keeps_them_alive(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]],
    app: Callable[..., Any],
    tmp_path: Path,
    request: pytest.FixtureRequest,
) -> None:
    robot, papers = house
    file = zenoh_file(tmp_path, "moves", papers("moves"))
    service = Process("moves", "--connect", robot.endpoint, "--set", f"zenoh.config={file}")
    request.addfinalizer(service.end)
    service.says("Moves are served")
    viewer, operator = (app(robot.endpoint, papers(name)) for name in ("viewer", "operator"))
    straight = b'{"moves": [{"kind": "straight", "distance_m": 3.0}]}'
    beat = b""

    def moves() -> bool:
        nonlocal beat
        # A busy machine ends moves, as it should.
        if operator.ask("yahboomd/moves")[0].get("state", "ended") == "ended":
            (answer,) = operator.ask("yahboomd/moves/start", straight)
            beat = json.dumps({"id": answer.get("data", {}).get("id", "")}).encode()
        operator.session.put("yahboomd/moves/beat", beat)
        return robot.travelled_m() > 0.1

    wait_for(moves, "it drives")
    assert viewer.is_refused("yahboomd/moves/cancel", beat)

    def over() -> bool:
        viewer.session.put("yahboomd/moves/beat", beat)
        return bool(operator.ask("yahboomd/moves")[0]["state"] == "ended")

    wait_for(over, "its end")
    assert operator.ask("yahboomd/moves")[0]["reason"] != "reached"
    assert viewer.is_refused("yahboomd/moves/start", straight)


def test_a_viewer_is_refused_cmd_vel_and_the_services_and_still_reads_the_pose(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]], app: Callable[..., Any]
) -> None:
    robot, papers = house
    viewer = app(robot.endpoint, papers("viewer"))
    operator = app(robot.endpoint, papers("operator"))
    viewer.sees_poses()

    viewer.drive()
    for key in ("estop/reset", "odometry/reset", "config", "board", "blackbox/save"):
        assert viewer.is_refused(f"yahboomd/{key}")
    assert viewer.is_refused("yahboomd/odometry/set_pose", b'{"x":1,"y":1,"theta":0}')
    # Its commands were sent before, over the same connection.
    assert sum(robot.settled_truth().travel_m) == pytest.approx(0.0, abs=1e-6)
    viewer.sees_poses()
    assert viewer.poses[-1]["x"] == pytest.approx(0.0, abs=1e-6)

    operator.drive_until(lambda: robot.travelled_m() > 0.4, "it drives")
    wait_for(lambda: viewer.poses[-1]["x"] > 0.15, "the viewer sees it")
    (newest,) = viewer.ask("yahboomd/pose")
    assert newest["x"] > 0.15

    (answer,) = viewer.ask("yahboomd/estop")
    assert answer["success"]
    driven = sum(robot.settled_truth().travel_m)
    operator.drive()
    assert sum(robot.settled_truth().travel_m) == pytest.approx(driven, abs=1e-3)
    (answer,) = wait_for(
        lambda: [a for a in operator.ask("yahboomd/estop/reset") if a["success"]], "the release"
    )
    operator.drive_until(lambda: robot.travelled_m() > driven + 0.3, "it drives again")


@pytest.mark.nightly
def test_the_python_client_drives_with_the_papers_of_its_file_and_a_viewer_reads(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]], tmp_path: Path
) -> None:
    robot, papers = house

    def program(name: str) -> Robot:
        file = zenoh_file(tmp_path, name, papers(name))
        return Robot(robot.endpoint, zenoh_file=file, wait_s=30.0)

    def stopped() -> bool:
        # A daemon that a busy machine holds up does not answer in time.
        with contextlib.suppress(NoDaemon):
            return bool(viewer.estop("the viewer"))
        return False

    with program("viewer") as viewer, program("operator") as operator:
        wait_for(lambda: viewer.alive and viewer.pose, "a pose")
        viewer.drive(0.3, for_s=60.0)
        with pytest.raises(NoDaemon):
            viewer.release()
        wait_for(lambda: operator.drive(0.3, for_s=60.0) and robot.travelled_m() > 0.1, "it drives")
        wait_for(stopped, "the stop")
        assert operator.standing(within_s=60.0)
        wait_for(lambda: viewer.status, "a status")


@pytest.mark.nightly
def test_somebody_who_is_known_and_named_in_no_rule_may_do_nothing(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]], app: Callable[..., Any]
) -> None:
    robot, papers = house
    stranger = app(robot.endpoint, papers("stranger"))
    viewer = app(robot.endpoint, papers("viewer"))
    stranger.drive()
    assert stranger.is_refused("yahboomd/estop/reset")
    assert stranger.is_refused("yahboomd/estop")
    viewer.sees_poses()
    assert stranger.poses == []
    assert sum(robot.settled_truth().travel_m) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.nightly
def test_the_tools_on_the_robot_are_heard_with_the_daemons_own_file_where_a_rule_names_them(
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    authority: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = mutual(example, authority)
    for found, added in HERE.items():
        assert text.count(found) == 1
        text = text.replace(found, found + added)
    robot = guarded(text, "tcp")
    file = f"zenoh.config={tmp_path / 'zenoh.json5'}"
    options = ["--connect", robot.endpoint, "--set", file]
    wait_for(lambda: main(["stop", *options]) == 0, "the daemon reports standing wheels")
    assert "Emergency stop engaged" in capsys.readouterr().out
    assert main(["monitor", "--once", *options]) == 0
    assert "state        estopped" in capsys.readouterr().out
    assert main(["stop", "--release", *options]) == 0


def forged(authority: Any, folder: Path) -> dict[str, Any]:
    """An operator's papers, signed by another authority."""
    forger = type(authority)(folder / "forger")
    forger.sign("operator")
    return forger.shown_by("operator") | {
        "transport/link/tls/root_ca_certificate": authority.path("ca.pem")
    }


def test_without_credentials_no_client_is_admitted(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]],
    app: Callable[..., Any],
    authority: Any,
    tmp_path: Path,
) -> None:
    robot, papers = house
    authority_alone = {"transport/link/tls/root_ca_certificate": authority.path("ca.pem")}
    wrong = papers("operator") | {"transport/auth/usrpwd/password": "guess"}
    attempts = [(robot.endpoint, authority_alone), (robot.endpoint, {})]
    if "transport/auth/usrpwd/user" in wrong:
        attempts.append((robot.endpoint, wrong))
    else:
        attempts.append((robot.endpoint, forged(authority, tmp_path)))
    attempts.append((robot.endpoint.replace("tls", "tcp"), {"transport/unicast/open_timeout": 500}))
    for endpoint, shown in attempts:
        with pytest.raises(zenoh.ZError):
            app(endpoint, shown)
    app(robot.endpoint, papers("viewer")).sees_poses()


@pytest.mark.nightly
def test_a_certificate_of_another_authority_is_none_to_the_native_plane_either(
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    app: Callable[..., Any],
    authority: Any,
    tmp_path: Path,
) -> None:
    robot = guarded(mutual(example, authority), "tls", natively=True)
    with pytest.raises(zenoh.ZError):
        app(robot.endpoint, forged(authority, tmp_path))
    app(robot.endpoint, authority.shown_by("operator")).sees_poses()


@pytest.mark.nightly
def test_a_viewer_drives_by_no_key_of_ros_either(
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    app: Callable[..., Any],
    authority: Any,
) -> None:
    """As the router of an rmw_zenoh graph the daemon tells its nodes of each other."""
    robot = guarded(mutual(example, authority), "tls", natively=True)
    node = ros2_names.Node(domain_id=0, zid="1")
    key = ros2_names.native_key(node, topic="cmd_vel", ros_type=ros2_names.TWIST, distro="jazzy")
    twist = struct.pack("<4s6d", cdr.HEADER_LE, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0)
    viewer, operator = (app(robot.endpoint, authority.shown_by(n)) for n in ("viewer", "operator"))
    for _ in range(20):
        viewer.session.put(key, twist)
        viewer.session.put("cmd_vel", twist)
        viewer.sees_poses()
    assert robot.travelled_m() == 0.0
    # The same bytes on a key that is his move the robot.
    wait_for(lambda: operator.session.put("cmd_vel", twist) or robot.travelled_m() > 0, "motion")


@pytest.mark.nightly
def test_others_drive_through_a_node_that_listens_and_reach_none_that_is_a_client(
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    authority: Any,
) -> None:
    """A program without papers, beside nodes of rmw_zenoh that have an operator's."""
    robot = guarded(mutual(example, authority), "tls", natively=True)
    twist = struct.pack("<4s6d", cdr.HEADER_LE, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0)

    def opened(mode: str, at: str, listen: str = "", **papers: Any) -> zenoh.Session:
        config = zenoh.Config()
        for key, value in {
            "mode": mode,
            "connect/endpoints": [at],
            "listen/endpoints": [listen] if listen else [],
            "scouting/multicast/enabled": False,
            "open/return_conditions/connect_scouted": False,
            **papers,
        }.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)

    papers = authority.shown_by("operator")
    safe, unsafe = free_endpoint(), free_endpoint()
    with opened("client", robot.endpoint, safe, **papers) as node:
        with pytest.raises(zenoh.ZError):
            opened("client", safe)
        with pytest.raises(zenoh.ZError):
            opened("client", robot.endpoint)
        assert robot.travelled_m() == 0.0
        wait_for(lambda: node.put("cmd_vel", twist) or robot.travelled_m() > 0, "the node drives")
    driven_m = sum(robot.settled_truth().travel_m)
    with opened("peer", robot.endpoint, unsafe, **papers), opened("client", unsafe) as stranger:
        wait_for(
            lambda: stranger.put("cmd_vel", twist) or robot.travelled_m() > driven_m + 0.3,
            "a stranger to drive through it",
        )


@pytest.mark.nightly
@pytest.mark.parametrize("house", ["certificates"], indirect=True)
def test_a_viewer_who_floods_the_estop_costs_the_operator_none_of_his_stops(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]], app: Callable[..., Any]
) -> None:
    """Stopping is every known client's right, so the rules let the flood through."""
    robot, papers = house
    operator = app(robot.endpoint, papers("operator"))
    seen: list[dict[str, Any]] = []
    operator.session.declare_subscriber(
        "yahboomd/status", lambda sample: seen.append(json.loads(bytes(sample.payload)))
    )
    flood = {
        "endpoint": robot.endpoint,
        "settings": papers("viewer"),
        "key": "yahboomd/estop",
        "how": "put",
        "payload": '{"engaged": false}',
        "hz": 1_000_000,
    }
    with subprocess.Popen(
        [sys.executable, str(FLOOD), json.dumps(flood)], stdout=subprocess.PIPE
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline()
            wait_for(
                lambda: seen and seen[-1]["command"].get("release_refused", 0) > 2_000, "the flood"
            )
            assert seen[-1]["state"] != "estopped"
            for _ in range(4):
                operator.session.put("yahboomd/estop", b"{}")
                wait_for(lambda: seen[-1]["state"] == "estopped", "the stop")
                # Within a second of the last release it might be a copy of that, and a daemon
                # that got no processor for two seconds has not answered.
                wait_for(
                    lambda: any(each["success"] for each in operator.ask("yahboomd/estop/reset")),
                    "the release",
                )
                wait_for(lambda: seen[-1]["state"] == "standing", "it to stand")
        finally:
            process.kill()
    assert seen[-1]["command"]["estops"] == 4


@pytest.mark.nightly
def test_a_flood_without_certificates_keeps_neither_the_connected_nor_this_machine_from_stopping(
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    app: Callable[..., Any],
    authority: Any,
) -> None:
    """Zenoh waits a tenth of a second after each handshake that fails, on that port alone."""
    text = mutual(example, authority)
    for found, added in HERE.items():
        text = text.replace(found, found + added)
    here = free_endpoint()
    robot = guarded(text, "tls", here)
    operator = app(robot.endpoint, authority.shown_by("operator"))
    port = int(robot.endpoint.rpartition(":")[2])
    trusting = ssl.create_default_context(cafile=authority.path("ca.pem"))
    ended, refused = threading.Event(), list[str]()

    def attempt() -> None:
        while not ended.is_set():
            try:
                with (
                    socket.create_connection(("localhost", port), timeout=1.0) as plain,
                    trusting.wrap_socket(plain, server_hostname="localhost") as connection,
                ):
                    connection.recv(1)
            except OSError as error:
                refused.append(str(error))

    threads = [threading.Thread(target=attempt) for _ in range(30)]
    for thread in threads:
        thread.start()
    try:
        wait_for(lambda: len(refused) > 60, "a flood")
        (answer,) = operator.ask("yahboomd/estop")
        assert answer["success"]
        wait_for(
            lambda: any(each["success"] for each in operator.ask("yahboomd/estop/reset")),
            "the release",
        )
        (answer,) = app(here).ask("yahboomd/estop")
        assert answer["success"]
    finally:
        ended.set()
        for thread in threads:
            thread.join()


@pytest.mark.nightly
def test_connections_that_wait_by_the_hundred_leave_a_descriptor_for_the_port(
    guarded: Callable[..., RealRobot], example: Callable[..., str], authority: Any
) -> None:
    """A replug in motion, among 1,200 silent clients without a certificate."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 4096:
        pytest.skip("this machine allows too few descriptors")
    with contextlib.ExitStack() as stack:
        stack.callback(resource.setrlimit, resource.RLIMIT_NOFILE, (soft, hard))
        # What most systems begin a process with.
        resource.setrlimit(resource.RLIMIT_NOFILE, (1024, hard))
        robot = guarded(mutual(example, authority), "tls")
        resource.setrlimit(resource.RLIMIT_NOFILE, (4096, hard))
        port = int(robot.endpoint.rpartition(":")[2])
        for _ in range(1_200):
            stack.enter_context(socket.create_connection(("localhost", port)))
        descriptors = Path(f"/proc/{robot.daemon.process.pid}/fd")
        wait_for(lambda: len(list(descriptors.iterdir())) > 1_100, "all of them are accepted")
        assert robot.do("unplug 0.5").startswith("ok")
        wait_for(lambda: robot.daemon.output.count("Connected") >= 2, "the port is open again")
    assert "Too many open files" not in robot.daemon.output
    assert "Traceback" not in robot.daemon.output
