"""The emergency stop outlives the process that received it."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from estop_kills import KillableRobot
from real_robot import Client, RealRobot, wait_for

from yahboomd.core.protocol.registry import DIALECTS

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_the_emergency_stop_is_still_engaged_after_a_restart(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], number: signal.Signals
) -> None:
    robot = real_robot()
    first = client("client", robot.endpoint)
    first.in_state("standing")
    first.drive(b'{"vx": 0.3}', 0.5)
    assert first.ask("yahboomd/estop")["success"]
    first.in_state("estopped")
    robot.daemon.end(number)
    stood = robot.settled_truth()
    robot.start_daemon()
    second = client("client", robot.endpoint)
    why = second.in_state("estopped")["why"]
    assert "Emergency stop" in why
    second.drive(b'{"vx": 0.3}', 0.5)
    assert robot.settled_truth().travel_m == pytest.approx(stood.travel_m, abs=0.001)
    wait_for(lambda: second.ask("yahboomd/estop/reset")["success"], "the release")
    second.in_state("standing")
    goal_m = sum(stood.travel_m) + 0.1
    second.drive_until(b'{"vx": 0.3}', lambda: robot.travelled_m() > goal_m, "it drives again")


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_daemon_that_is_killed_after_its_acknowledgement_has_stopped_the_robot(
    tmp_path: Path, dialect: str
) -> None:
    # At length: `make estop-kills`.
    robot = KillableRobot(tmp_path, dialect, seed=3)
    try:
        assert [robot.kill_one() for _ in range(5)] == [None] * 5
    finally:
        robot.close()


def test_an_emergency_stop_that_could_not_be_written_is_written_when_it_can_be(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], tmp_path: Path
) -> None:
    disk = tmp_path / "disk"
    # A file stands in the folder's place, so that not even root can write.
    disk.touch()
    robot = real_robot(run=["--set", f"estop.latch_file={disk / 'estop'}"])
    first = client("client", robot.endpoint)
    # What cannot be read counts as engaged, and is not released.
    assert "its folder cannot be used" in first.in_state("estopped")["why"]
    assert "not on file" in first.in_state("estopped")["why"]
    assert not first.ask("yahboomd/estop/reset")["success"]
    assert first.latest("status")["command"]["estop_not_on_file"] == 1
    disk.unlink()
    wait_for(lambda: first.ask("yahboomd/estop")["success"], "it is sent to the board")
    wait_for((disk / "estop").exists, "the latch is on file")
    robot.daemon.end(signal.SIGKILL)
    robot.start_daemon()
    second = client("client", robot.endpoint)
    second.in_state("estopped")
    assert second.ask("yahboomd/estop/reset")["success"]
    second.in_state("standing")


def test_a_second_daemon_under_the_same_name_is_an_event_to_both(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    one = real_robot(run=["--namespace", "bot1"])
    app = client("client", one.endpoint, "bot1/yahboomd")
    app.in_state("standing")
    joined = f'zenoh.connect=["{one.endpoint}"]'
    two = real_robot(run=["--namespace", "bot1", "--set", joined])
    words = "uses the same namespace: what reaches both moves both"
    two.daemon.says(words)
    one.daemon.says(words)
    wait_for(
        lambda: any(each["kind"] == "second_daemon" for each in app.samples.get("events", [])),
        "the event",
    )
