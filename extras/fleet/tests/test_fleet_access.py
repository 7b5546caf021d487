"""A real daemon in a fleet, with the files as `yahboomd fleet` wrote them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh
from fleet_bench import ROBOTS, FleetBench
from real_robot import RealRobot, free_endpoint, wait_for

pytestmark = pytest.mark.realtime

ONE = ROBOTS["bot1"]
DRIVE = b'{"vx": 0.3, "wz": 0.0}'


@pytest.fixture
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FleetBench]:
    made = FleetBench(tmp_path_factory.mktemp("fleet"))
    made.open_routers()
    try:
        yield made
    finally:
        made.close()


def answers(session: zenoh.Session, key: str, timeout_s: float = 60.0) -> list[dict[str, Any]]:
    replies = session.get(f"{ONE}/{key}", timeout=timeout_s)
    return [json.loads(reply.ok.payload.to_string()) for reply in replies if reply.ok]


@pytest.mark.nightly
def test_another_robots_certificate_neither_drives_a_robot_nor_resets_it_and_the_fleets_stop_does(
    bench: FleetBench, real_robot: Callable[..., RealRobot]
) -> None:
    settings = {
        "zenoh.listen": json.dumps([free_endpoint(), f"tls/{bench.addresses['bot1']}"]),
        "zenoh.connect": json.dumps([f"tls/{bench.addresses['north']}"]),
        "zenoh.config": json.dumps(str(bench.file("robots/bot1"))),
    }
    sets = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    robot = real_robot(run=["--config", str(bench.file("robots/bot1", ".toml")), *sets])
    robot.daemon.says("Connected")
    with bench.person("people/max", "top") as session:
        wait_for(lambda: answers(session, "yahboomd/status", 2.0), "its status")
        for where in ("north", "top", "bot1"):
            with bench.person("robots/bot2", where) as thief:
                zid = str(thief.zid())
                for _ in range(20):
                    for source in ("cmd_vel", "cmd_vel/max", "cmd_vel/bot2"):
                        thief.put(f"{ONE}/{source}", DRIVE)
                    thief.put(f"{ONE}/yahboomd/odometry/set_pose", b'{"x":5,"y":0,"theta":0}')
                    thief.get(f"{ONE}/yahboomd/odometry/set_pose", payload=b'{"x":5}', timeout=0.1)
                    thief.get(f"{ONE}/yahboomd/estop/reset", timeout=0.1)
            if where != "bot1":
                bench.gone(where, zid)
        assert robot.travelled_m() == 0.0
        pose = wait_for(
            lambda: next((each for each in answers(session, "yahboomd/pose") if "x" in each), None),
            "a pose",
        )
        assert pose["x"] == pytest.approx(0.0, abs=1e-6)
        # The same command moves it for somebody who may drive.
        wait_for(
            lambda: session.put(f"{ONE}/cmd_vel/max", DRIVE) or robot.travelled_m() > 0.1,
            "it drives",
        )
        with bench.person("people/vera", "top") as viewer:

            def stopped() -> bool:
                viewer.put("farm/yahboomd/estop", b"{}")
                return answers(session, "yahboomd/status")[0]["state"] == "estopped"

            wait_for(stopped, "the fleet's stop reached it")
            driven = sum(robot.settled_truth().travel_m)
            session.put(f"{ONE}/cmd_vel/max", DRIVE)
            (answer,) = answers(viewer, "yahboomd/estop")
            assert answer["success"]
            assert answers(viewer, "yahboomd/estop/reset", 1.0) == []
        assert sum(robot.settled_truth().travel_m) == pytest.approx(driven, abs=1e-3)
        released = wait_for(
            lambda: [each for each in answers(session, "yahboomd/estop/reset") if each["success"]],
            "a person who may releases it",
        )
        assert len(released) == 1
