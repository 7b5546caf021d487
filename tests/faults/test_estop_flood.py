"""The e-stop's own key flooded by another client, and messages that carry megabytes.

Real processes on a real bus; nothing here is judged by time.
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from real_robot import Client, RealRobot, wait_for

# Each occupies every core: one after the other.
pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("floods")]

FLOOD = Path(__file__).parents[1] / "plugins" / "zenoh_flood_process.py"
REFUSED = '{"engaged": false}'
MEGABYTES = 15_000_000
FLOODS = {
    "samples": "put",
    "queries": "get",
}
"""As fast as it goes."""


@contextlib.contextmanager
def floods(*whats: dict[str, Any]) -> Iterator[None]:
    """Clients that send as they are asked to, for as long as the block lasts."""
    with contextlib.ExitStack() as stack:
        for what in whats:
            process = subprocess.Popen(
                [sys.executable, str(FLOOD), json.dumps(what)],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            stack.enter_context(process)
            stack.callback(process.kill)
            assert process.stdout is not None
            assert process.stdout.readline()
        yield


def counted(app: Client, counter: str) -> int:
    """A counter of the newest status."""
    return int(app.latest("status")["command"].get(counter, 0))


class Operator:
    """Stops and releases, one time after another."""

    def __init__(self, robot: RealRobot, client: Callable[..., Client]) -> None:
        self.app = client("client", robot.endpoint, prefix="yahboomd/status")

    def release(self) -> None:
        wait_for(lambda: self.app.ask("yahboomd/estop/reset")["success"], "the release")
        self.app.in_state("standing")

    def stop(self, way: str) -> None:
        if way == "sample":
            self.app.session.put("yahboomd/estop", b"{}")
        else:
            assert self.app.ask("yahboomd/estop", b"{}")["success"]
        self.app.in_state("estopped")


@pytest.mark.parametrize("how", FLOODS.values(), ids=FLOODS)
def test_no_estop_is_lost_and_none_caused_while_another_client_floods_its_key_with_refusals(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], how: str
) -> None:
    robot = real_robot()
    operator = Operator(robot, client)
    operator.app.in_state("standing")
    flood = {"endpoint": robot.endpoint, "key": "yahboomd/estop", "how": how}
    with floods(flood | {"payload": REFUSED, "hz": 1_000_000}):
        wait_for(lambda: counted(operator.app, "release_refused") > 1_000, "the flood")
        assert counted(operator.app, "estops") == 0
        for number in range(4):
            operator.stop("sample" if number % 2 else "query")
            operator.release()
        refused = counted(operator.app, "release_refused")
        wait_for(lambda: counted(operator.app, "release_refused") > refused, "the flood goes on")
    assert counted(operator.app, "estops") == 4
    assert "Traceback" not in robot.daemon.output


def test_estops_by_query_are_not_refused_while_others_fill_the_queue(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    operator = Operator(robot, client)
    operator.app.in_state("standing")
    flood = {"endpoint": robot.endpoint, "key": "yahboomd/estop", "how": "get", "hz": 1_000_000}
    with floods(flood):
        operator.app.in_state("estopped")
        wait_for(lambda: counted(operator.app, "estops") > 1_000, "the flood")
    assert operator.app.latest("status")["state"] == "estopped"

    def released() -> bool:
        # Samples still on their way when the flood ended may engage the stop once more.
        operator.app.ask("yahboomd/estop/reset")
        return operator.app.latest("status")["state"] == "standing"

    wait_for(released, "the release")


def peak_mb(robot: RealRobot) -> float:
    """The most memory that the daemon ever had in use."""
    for line in Path(f"/proc/{robot.daemon.process.pid}/status").read_text().splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024
    raise AssertionError("no such process")


COMMAND = {"key": "cmd_vel", "how": "put", "payload": '{"vx": 0}'}
CARRIED = {
    "attachments of commands": (COMMAND | {"attachment": MEGABYTES}, "oversize"),
    "attachments of samples on the e-stop": (
        {"key": "yahboomd/estop", "how": "put", "payload": REFUSED, "attachment": MEGABYTES},
        "estops_unread",
    ),
}


@pytest.mark.parametrize("small_ones_too", [False, True], ids=["alone", "among small ones"])
@pytest.mark.parametrize(("what", "counter"), CARRIED.values(), ids=CARRIED)
def test_memory_is_bounded_whatever_samples_carry(
    real_robot: Callable[..., RealRobot],
    client: Callable[..., Client],
    what: dict[str, Any],
    counter: str,
    small_ones_too: bool,
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint, prefix="yahboomd/status")
    app.in_state("standing")
    before_mb = peak_mb(robot)
    flood = what | {"endpoint": robot.endpoint, "hz": 1_000_000}
    small = {name: value for name, value in flood.items() if name != "attachment"} | {"hz": 5_000}
    with floods(flood, flood, *([small] if small_ones_too else [])):
        wait_for(lambda: counted(app, counter) > 24, "0.36 gigabytes", 300.0)
        grown_mb = peak_mb(robot) - before_mb
    print(f"{grown_mb:+.1f} MB at most")
    assert grown_mb < 160


def test_memory_is_bounded_whatever_queries_carry(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client]
) -> None:
    robot = real_robot()
    app = client("client", robot.endpoint, prefix="yahboomd/status")
    app.in_state("standing")
    before_mb = peak_mb(robot)

    def refused() -> int:
        return int(app.latest("status")["bus"]["requests_refused"])

    flood = {"endpoint": robot.endpoint, "key": "yahboomd/board", "how": "get", "hz": 1_000_000}
    flood["attachment"] = MEGABYTES
    with floods(flood, flood):
        wait_for(lambda: refused() > 24, "0.36 gigabytes", 300.0)
        grown_mb = peak_mb(robot) - before_mb
    print(f"{grown_mb:+.1f} MB at most")
    assert grown_mb < 160
