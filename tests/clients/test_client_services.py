"""Every example reads pose, status and configuration, stops and releases a real daemon."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from real_robot import Client, RealRobot, free_endpoint, wait_for

pytestmark = pytest.mark.realtime

USAGE = 64
NO_DAEMON = 69
NAMESPACE = "bot1"
ASKING = ("pose", "estop", "release", "config")


@pytest.mark.commands("pose", "status", "estop", "release", "set-pose", "config")
def test_it_reads_sets_stops_and_releases(
    program: Any, real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot(run=["--set", f"zenoh.namespace={NAMESPACE}"])
    robot.daemon.says("Connected")
    app = client("client", robot.endpoint, f"{NAMESPACE}/yahboomd")
    app.in_state("standing")

    def answered(*arguments: str) -> Any:
        done = program.run(*arguments, robot=robot.endpoint, namespace=NAMESPACE)
        # A daemon that a busy machine holds up does not answer in time.
        return done if done.code != NO_DAEMON else None

    def ask(*arguments: str, code: int = 0) -> dict[str, Any]:
        done = wait_for(lambda: answered(*arguments), "an answer")
        assert done.code == code, done
        (line,) = done.out.splitlines()
        values: dict[str, Any] = json.loads(line)
        return values

    app.latest("pose")
    assert ask("set-pose", "1.5", "-2.25", "0.5")["success"]
    wait_for(lambda: app.latest("pose")["x"] == 1.5, "the new pose")
    pose = ask("pose")
    assert (pose["x"], pose["y"], pose["theta"]) == (1.5, -2.25, 0.5)
    wait_for(
        lambda: pose["stamp_ns"] in [each["stamp_ns"] for each in app.samples["pose"]],
        "the same pose, published",
    )
    refused = ask("set-pose", "1e9", "0", "0", code=1)
    assert not refused["success"]
    assert refused["message"]
    assert ask("config")["data"]["zenoh"]["namespace"] == NAMESPACE
    assert ask("status")["state"] == "standing"
    assert ask("estop")["success"]
    assert ask("status")["state"] == "estopped"
    assert ask("release")["success"]
    wait_for(lambda: ask("status")["state"] == "standing", "the release")


@pytest.mark.parametrize(
    "command",
    ["status", *(pytest.param(each, marks=pytest.mark.nightly) for each in (*ASKING, "square"))],
)
def test_without_a_daemon_it_names_the_endpoint_and_what_starts_one(
    program: Any, command: str
) -> None:
    endpoint = free_endpoint()
    done = program.run(command, robot=endpoint)
    assert (done.code, done.out) == (NO_DAEMON, ""), done
    assert program.address(endpoint) in done.err
    assert "yahboomd run" in done.err
    assert len(done.err.splitlines()) <= 3, done.err


@pytest.mark.commands("status")
def test_with_another_namespace_it_names_the_key_that_no_one_answers(
    program: Any, zenoh_router: Any
) -> None:
    zenoh_router.start()
    done = program.run("status", robot=zenoh_router.endpoint, namespace="bot2")
    assert (done.code, done.out) == (NO_DAEMON, ""), done
    assert "bot2/yahboomd/status" in done.err
    assert len(done.err.splitlines()) <= 3, done.err


@pytest.mark.parametrize(
    "words",
    [
        ["fly"],
        *(
            pytest.param(each, marks=pytest.mark.nightly)
            for each in ([], ["set-pose", "1"], ["decode", "Twist"])
        ),
    ],
    ids=str,
)
def test_wrong_arguments_are_answered_with_the_right_ones(program: Any, words: list[str]) -> None:
    done = program.run(*words)
    assert (done.code, done.out) == (USAGE, ""), done
    assert "set-pose X Y THETA" in done.err
