"""`yahboomd status` of a real daemon."""

from __future__ import annotations

import json
import signal
from collections.abc import Callable
from typing import get_args

import pytest
from real_robot import RealRobot, free_endpoint, wait_for

from yahboomd.cli.main import main
from yahboomd.cli.status import EXIT_STATUS, UNKNOWN
from yahboomd.core.messages.native import State, StatusSample
from yahboomd.tools.stop.unresponsive import process_state

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("one_robot")]


def test_a_robot_that_can_drive_is_described_with_status_0(
    on_robot: Callable[..., int], capsys
) -> None:
    def ready() -> bool:
        capsys.readouterr()
        return on_robot("status") == 0

    wait_for(ready, "a robot that can drive")
    lines = dict(line.split(maxsplit=1) for line in capsys.readouterr().out.splitlines())
    assert lines["state"].startswith("standing for ")
    assert lines["driver"] == "no source has control"
    assert lines["board"].startswith("streamed 1.7.3 on ")


def test_an_emergency_stop_is_said_and_has_a_status_of_its_own(
    on_robot: Callable[..., int], capsys
) -> None:
    assert on_robot("call", "estop", '{"by": "the test"}') == 0
    capsys.readouterr()
    try:
        wait_for(lambda: on_robot("status") == 3, "the emergency stop")
        said = capsys.readouterr().out
        assert "estopped for " in said
        assert "engaged by the test" in said
    finally:
        assert on_robot("call", "estop/reset") == 0
    wait_for(lambda: on_robot("status") == 0, "it is ready again")


def test_json_is_the_sample_in_one_line(on_robot: Callable[..., int], capsys) -> None:
    assert on_robot("status", "--json") == 0
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    assert set(json.loads(said)) == set(StatusSample.__struct_fields__)


def test_without_a_daemon_it_says_where_it_looked_and_ends_with_69(capsys) -> None:
    endpoint = free_endpoint()
    assert main(["status", "--connect", endpoint, "--timeout", "0"]) == 69
    out, err = capsys.readouterr()
    assert out == ""
    assert endpoint in err
    assert "yahboomd run" in err


def test_a_suspended_daemon_of_this_machine_is_named_with_what_its_wheels_do(
    one_robot: RealRobot, on_robot: Callable[..., int], capsys
) -> None:
    process = one_robot.daemon.process
    process.send_signal(signal.SIGSTOP)
    try:
        wait_for(lambda: process_state(process.pid) == "T", "it is suspended")
        assert on_robot("status", "--timeout", "0.2") == 69
    finally:
        process.send_signal(signal.SIGCONT)
    words = capsys.readouterr().err
    assert f"yahboomd (pid {process.pid}) is suspended" in words
    assert "the wheels keep their last speed" in words
    assert "Stop them: yahboomd stop\n" in words


def test_every_state_has_a_status() -> None:
    assert set(get_args(State)) == set(EXIT_STATUS)
    drive = {state for state, number in EXIT_STATUS.items() if number == 0}
    assert drive == {"standing", "driving", "stopping"}
    # One that only a later version knows is none of those.
    assert UNKNOWN != 0
