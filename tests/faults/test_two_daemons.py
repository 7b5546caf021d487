"""Two daemons under one namespace, which somebody forgot to tell apart: a stop is for both."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest
from real_robot import PATIENCE_S, Client, RealRobot, wait_for
from zenoh_fixtures import ZenohRouter

from yahboomd.cli.main import main

pytestmark = pytest.mark.realtime


def pair(
    real_robot: Callable[..., RealRobot], router: ZenohRouter, behind_it: bool
) -> tuple[list[RealRobot], str]:
    """Both robots, behind a router or one behind the other, and the endpoint for clients."""
    endpoint, robots = router.endpoint, []
    if behind_it:
        router.start()
    else:
        robots = [real_robot()]
        endpoint = robots[0].endpoint
    while len(robots) < 2:
        robots.append(real_robot(run=["--set", f'zenoh.connect=["{endpoint}"]']))
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


@pytest.mark.parametrize(
    ("behind_a_router", "way"),
    [
        (True, "query"),
        pytest.param(False, "sample", marks=pytest.mark.nightly),
        pytest.param(False, "yahboomd stop", marks=pytest.mark.nightly),
    ],
)
def test_an_estop_stops_both_of_two_daemons_in_one_namespace(
    real_robot: Callable[..., RealRobot],
    zenoh_router: ZenohRouter,
    client: Callable[..., Client],
    behind_a_router: bool,
    way: str,
) -> None:
    robots, endpoint = pair(real_robot, zenoh_router, behind_a_router)
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
        robot.daemon.says("Emergency stop engaged")
        wait_for(robot.stands, "the wheels stand")


@pytest.mark.nightly
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
