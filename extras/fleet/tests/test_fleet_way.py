from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.core.bus.bus import Bus
from yahboomd.core.errors import BusError
from yahboomd_fleet.fleet_way import FleetWay


class IdleWay(FleetWay):
    async def work(self, bus: Bus) -> None:
        raise AssertionError(bus)


def way(*places: str, papers: Path | None = None) -> FleetWay:
    return IdleWay("tcp/127.0.0.1:1", papers, list(places))


def test_a_fleet_a_site_and_a_robot_are_each_asked_by_one_selector() -> None:
    assert way("farm", "barn/north", "barn/south/bot1", "").wide("yahboomd/status") == [
        "farm/*/*/yahboomd/status",
        "barn/north/*/yahboomd/status",
        "barn/south/bot1/yahboomd/status",
        "**/yahboomd/status",
    ]


def test_a_way_leads_to_the_robots_of_its_places_alone() -> None:
    assert way("farm/north").leads_to("farm/north/bot1")
    assert not way("farm/north").leads_to("farm/northern/bot1")
    assert way("farm/north/bot1").leads_to("farm/north/bot1")
    assert way("").leads_to("bot1")


async def test_papers_that_are_none_end_it(tmp_path: Path) -> None:
    (tmp_path / "broken.json5").write_text("{")
    with pytest.raises(BusError, match="cannot be used"):
        await way("farm", papers=tmp_path / "broken.json5").run()
