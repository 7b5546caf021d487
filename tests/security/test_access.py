"""Who may drive, on a real robot: the examples, with certificates and passwords made here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import zenoh
from real_robot import RealRobot, wait_for

from yahboomd.cli.main import main

pytestmark = pytest.mark.realtime

HERE = {
    "    subjects: [\n": '{ id: "here", interfaces: ["lo"] },',
    "    policies: [\n": '{ subjects: ["here"], '
    'rules: ["out", "watch", "stop", "drive", "services"] },',
}
"""What docs/security.md adds for the programs of this machine."""

PASSWORDS = {"operator": "first", "viewer": "second", "stranger": "third"}


@pytest.fixture(params=["users", "certificates"])
def house(
    request: pytest.FixtureRequest,
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    authority: Any,
    tmp_path: Path,
) -> tuple[RealRobot, Callable[[str], dict[str, Any]]]:
    """A guarded robot, and the papers of each name."""
    if request.param == "certificates":
        text = example(
            "zenoh-mtls.json5",
            ca_pem=authority.path("ca.pem"),
            robot_pem=authority.path("robot.pem"),
            robot_key=authority.path("robot.key"),
        )
        return guarded(text, "tls"), authority.shown_by

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


def test_a_viewer_is_refused_cmd_vel_and_the_services_and_still_reads_the_pose(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]], app: Callable[..., Any]
) -> None:
    robot, papers = house
    viewer = app(robot.endpoint, papers("viewer"))
    operator = app(robot.endpoint, papers("operator"))
    viewer.sees_poses()

    viewer.drive()
    for key in ("estop/reset", "odometry/reset", "config", "board"):
        assert viewer.ask(f"yahboomd/{key}") == []
    assert viewer.ask("yahboomd/odometry/set_pose", b'{"x":1,"y":1,"theta":0}') == []
    # Its commands were sent before, over the same connection.
    assert sum(robot.settled_truth().travel_m) == pytest.approx(0.0, abs=1e-6)
    viewer.sees_poses()
    assert viewer.poses[-1]["x"] == pytest.approx(0.0, abs=1e-6)

    operator.drive()
    assert sum(robot.settled_truth().travel_m) > 0.3
    viewer.sees_poses()
    assert viewer.poses[-1]["x"] > 0.15

    (answer,) = viewer.ask("yahboomd/estop")
    assert answer["success"]
    driven = sum(robot.settled_truth().travel_m)
    operator.drive()
    assert sum(robot.settled_truth().travel_m) == pytest.approx(driven, abs=1e-3)
    (answer,) = wait_for(
        lambda: [a for a in operator.ask("yahboomd/estop/reset") if a["success"]], "the release"
    )
    operator.drive()
    assert sum(robot.settled_truth().travel_m) > driven + 0.3


def test_somebody_who_is_known_and_named_in_no_rule_may_do_nothing(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]], app: Callable[..., Any]
) -> None:
    robot, papers = house
    stranger = app(robot.endpoint, papers("stranger"))
    viewer = app(robot.endpoint, papers("viewer"))
    stranger.drive()
    assert stranger.ask("yahboomd/estop/reset") == []
    assert stranger.ask("yahboomd/estop") == []
    viewer.sees_poses()
    assert stranger.poses == []
    assert sum(robot.settled_truth().travel_m) == pytest.approx(0.0, abs=1e-6)


def test_the_tools_on_the_robot_are_heard_with_the_daemons_own_file_where_a_rule_names_them(
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    authority: Any,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = example(
        "zenoh-mtls.json5",
        ca_pem=authority.path("ca.pem"),
        robot_pem=authority.path("robot.pem"),
        robot_key=authority.path("robot.key"),
    )
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


def test_without_papers_nobody_is_let_in(
    house: tuple[RealRobot, Callable[[str], dict[str, Any]]],
    app: Callable[..., Any],
    authority: Any,
) -> None:
    robot, papers = house
    authority_alone = {"transport/link/tls/root_ca_certificate": authority.path("ca.pem")}
    wrong = papers("operator") | {"transport/auth/usrpwd/password": "guess"}
    attempts = [(robot.endpoint, authority_alone), (robot.endpoint, {})]
    if "transport/auth/usrpwd/user" in wrong:
        attempts.append((robot.endpoint, wrong))
    attempts.append((robot.endpoint.replace("tls", "tcp"), {"transport/unicast/open_timeout": 500}))
    for endpoint, shown in attempts:
        with pytest.raises(zenoh.ZError):
            app(endpoint, shown)
    app(robot.endpoint, papers("viewer")).sees_poses()


def test_a_certificate_of_another_authority_is_none(
    guarded: Callable[..., RealRobot],
    example: Callable[..., str],
    app: Callable[..., Any],
    authority: Any,
    tmp_path: Path,
) -> None:
    text = example(
        "zenoh-mtls.json5",
        ca_pem=authority.path("ca.pem"),
        robot_pem=authority.path("robot.pem"),
        robot_key=authority.path("robot.key"),
    )
    robot = guarded(text, "tls")
    forger = type(authority)(tmp_path / "forger")
    forger.sign("operator")
    papers = forger.shown_by("operator") | {
        "transport/link/tls/root_ca_certificate": authority.path("ca.pem")
    }
    with pytest.raises(zenoh.ZError):
        app(robot.endpoint, papers)
    app(robot.endpoint, authority.shown_by("operator")).sees_poses()
