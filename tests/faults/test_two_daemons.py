"""Two daemons under one namespace, which somebody forgot to tell apart: a stop is for both."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from real_robot import PATIENCE_S, Client, RealRobot, wait_for
from zenoh_fixtures import ZenohRouter

from yahboomd.cli.main import main

pytestmark = pytest.mark.realtime

Pair = tuple[list[RealRobot], str]


@pytest.fixture(params=["behind a router", "one behind the other"])
def pair(
    request: pytest.FixtureRequest,
    real_robot: Callable[..., RealRobot],
    zenoh_router: ZenohRouter,
) -> Pair:
    """Both robots, and the endpoint for clients."""
    if request.param == "behind a router":
        zenoh_router.start()
        joined = ["--set", f'zenoh.connect=["{zenoh_router.endpoint}"]']
        robots = [real_robot(run=joined), real_robot(run=joined)]
        endpoint = zenoh_router.endpoint
    else:
        first = real_robot()
        endpoint = first.endpoint
        robots = [first, real_robot(run=["--set", f'zenoh.connect=["{endpoint}"]'])]
    for robot in robots:
        robot.daemon.says("Connected")
        robot.daemon.says("Another yahboomd")
        robot.daemon.says("such as --set zenoh.namespace=bot2")
    return robots, endpoint


def drive(robots: list[RealRobot], client: Client) -> None:
    """Until the wheels of all turn."""

    def turning() -> bool:
        client.session.put("cmd_vel", b'{"vx": 0.3}')
        return all(min(robot.truth()[-1].speed_m_s) > 0.2 for robot in robots)

    wait_for(turning, "all wheels turn")


def stopped(robot: RealRobot) -> None:
    robot.daemon.says("Emergency stop engaged")
    wait_for(robot.stands, "the wheels stand")


@pytest.mark.parametrize("way", ["query", "sample", "yahboomd stop"])
def test_an_estop_stops_both_of_two_daemons_in_one_namespace(
    pair: Pair, client: Callable[..., Client], way: str
) -> None:
    robots, endpoint = pair
    app = client("client", endpoint)
    drive(robots, app)
    if way == "query":
        # As docs/bus.md shows it: no target is named.
        assert app.ask("yahboomd/estop")["success"]
    elif way == "sample":
        app.session.put("yahboomd/estop", b"")
    else:
        main(["stop", "--connect", endpoint])
    for robot in robots:
        stopped(robot)


def test_a_query_with_wildcards_stops_the_robots_of_all_namespaces_and_one_for_everything_none(
    real_robot: Callable[..., RealRobot], zenoh_router: ZenohRouter, client: Callable[..., Client]
) -> None:
    zenoh_router.start()
    joined = ["--set", f'zenoh.connect=["{zenoh_router.endpoint}"]']
    names = ("bot1", "bot2")
    robots = [real_robot(run=[*joined, "--set", f"zenoh.namespace={name}"]) for name in names]
    for robot in robots:
        robot.daemon.says("Connected")
    session = client("client", zenoh_router.endpoint, "nothing").session

    def both(selector: str, success: bool, key: str = "yahboomd/estop") -> bool:
        """Whether both robots answer on a key, and so."""
        said = {
            str(reply.ok.key_expr): json.loads(bytes(reply.ok.payload)).get("success")
            for reply in session.get(selector, timeout=PATIENCE_S)
            if reply.ok is not None
        }
        return [said.get(f"{name}/{key}") for name in names] == [success, success]

    for everything in ("**", "*/yahboomd/*"):
        # Until both have joined the router.
        wait_for(lambda each=everything: both(each, False), everything)
    assert both("*/yahboomd/estop", True)
    for robot in robots:
        robot.daemon.says("Emergency stop engaged by a query")
    assert both("**/estop/reset", False, "yahboomd/estop/reset"), "nothing is released by wildcards"
