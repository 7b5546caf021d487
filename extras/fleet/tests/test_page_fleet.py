"""The robots of a fleet on a page: under their access rules, on real routers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import daemon_samples
import pytest
from fleet_bench import LATE, ROBOTS, STANDS, FleetBench
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.core.clock import SystemClock
from yahboomd.core.errors import ConfigError
from yahboomd.core.messages.codecs import encode
from yahboomd_fleet import page_fleet
from yahboomd_fleet.page_fleet import PageFleet

pytestmark = pytest.mark.realtime

ONE, TWO, THREE = ROBOTS.values()
STANDING = encode(daemon_samples.status("standing", driver=None), "json")


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FleetBench]:
    made = FleetBench(tmp_path_factory.mktemp("fleet"))
    try:
        made.start()
        made.settled()
        for robot in made.robots.values():
            robot.answer = STANDS
            robot.answers = {"yahboomd/status": STANDING}
            robot.live()
        yield made
    finally:
        made.close()


async def asked(served: Any, method: str, path: str, **headers: str) -> Any:
    status, _, body = await served.request(method, path, **headers)
    assert status == 200
    return json.loads(body)


async def test_a_page_lists_every_robot_and_stops_all_of_them(site: Any, bench: FleetBench) -> None:
    fleet = PageFleet(bench.file("people/vera"), SystemClock())
    served = await site(endpoint=free_endpoint(), fleet=fleet)
    page = await served.page()
    assert page.of("hello")[-1]["fleet"] is True
    found = await asked(served, "GET", "/fleet")
    while sum(row["can_drive"] for row in found["robots"]) < 3:
        found = await asked(served, "GET", "/fleet")
    assert [row["robot"] for row in found["robots"]] == [LATE, ONE, TWO, THREE]
    assert found["summary"] == "4 robots; 1 need somebody: 1 not reachable."
    assert (found["stop"], found["stopping"]) == ([], False)
    silent = bench.robots["bot2"]
    silent.answer = ""
    found = await asked(served, "POST", "/fleet/stop")
    assert found["stopping"]
    missing = [
        f"{TWO}: did not answer, although its daemon is there.",
        f"{LATE}: is not reachable.",
    ]
    while found["stop"][1:] != missing:
        found = await asked(served, "GET", "/fleet")
    assert found["stop"][0].startswith("2 of 4 robots acknowledged")
    # A second press asks those that acknowledged once more.
    before = bench.robots["bot1"].asked
    silent.answer = STANDS
    await asked(served, "POST", "/fleet/stop")
    await eventually(lambda: bench.robots["bot1"].asked > before)
    while not found["stop"][0].startswith("3 of 4 robots acknowledged"):
        found = await asked(served, "GET", "/fleet")
    assert found["stopping"]


async def test_nobody_is_asked_when_no_page_has_asked_for_a_while(
    bench: FleetBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_fleet, "LOOK_S", 0.0)
    fleet = PageFleet(bench.file("people/vera"), SystemClock())
    fleet.shown()
    first = fleet._looking
    assert first is not None
    await eventually(first.done)
    # The next page that asks begins anew.
    fleet.shown()
    assert fleet._looking is not first
    await fleet.close()


def test_a_file_that_lists_no_robots_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        PageFleet(tmp_path / "none.json5", SystemClock())
