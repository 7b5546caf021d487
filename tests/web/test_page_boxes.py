"""Black boxes on a page: listed, explained and downloaded with a session, saved by drivers."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from real_robot import RealRobot
from web_site import Site
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.blackbox.box_file import read_box
from yahboomd.web import page_boxes
from yahboomd.web.page_boxes import BUSY, PageBoxes

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("web_tools")]


NAME = "000007_20261122T173530Z_estop"


class StillClock:
    """A clock that is set."""

    ns = 10**12

    def now_ns(self) -> int:
        return self.ns


@pytest.fixture
def boxes(tmp_path: Path) -> PageBoxes:
    folder = tmp_path / "boxes"
    folder.mkdir()
    (folder / f"{NAME}.blackbox").write_bytes(b"no box at all")
    (tmp_path / "secret").write_text("secret")
    return PageBoxes(StillClock(), [f"--set=blackbox.folder={folder}"])  # type: ignore[arg-type]


async def test_no_name_leads_to_another_file_or_option(boxes: PageBoxes) -> None:
    """And they are listed without their paths."""
    listed = await boxes.listed()
    # This machine may have others.
    (box,) = [each for each in listed["boxes"] if each["name"] == NAME]
    assert (box["name"], box["reason"], box["bytes"]) == (NAME, "estop", 13)
    assert "path" not in box
    assert await boxes.file(NAME) is not None
    for name in ("", "..", "../secret", "/etc/passwd", "8", "-h", "--json", "7", NAME + "\n"):
        assert await boxes.file(name) is None
        assert await boxes.explained(name) is None
    found = await boxes.explained(NAME)
    assert found is not None
    assert "no black box" in found["why"]
    assert found["lines"] == []


@pytest.mark.nightly
async def test_a_list_is_as_old_as_its_beginning(
    boxes: PageBoxes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is saved while a slow machine makes one is in the next."""
    ask = boxes._ask

    async def slowly(arguments: list[str]) -> tuple[int, str, str]:
        answer = await ask(arguments)
        boxes._clock.ns += page_boxes.KNOWN_NS  # type: ignore[attr-defined]
        return answer

    monkeypatch.setattr(boxes, "_ask", slowly)
    await boxes.listed()
    later = NAME.replace("7", "8", 1)
    (tmp_path / "boxes" / f"{later}.blackbox").write_bytes(b"none either")
    assert await boxes.file(later) is not None


@pytest.mark.nightly
async def test_no_more_than_some_wait_for_their_turn(
    boxes: PageBoxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_boxes, "WAITING", 1)
    asked = [boxes.listed() for _ in range(3)]
    first, *refused = await asyncio.gather(*asked, return_exceptions=True)
    assert isinstance(first, dict)
    assert [(each.status_code, each.detail) for each in refused] == [(503, BUSY)] * 2  # type: ignore[union-attr]


@pytest.mark.nightly
async def test_an_emergency_stop_is_explained_downloaded_and_another_box_saved_on_demand(
    site: Callable[..., Awaitable[Site]], real_robot: Callable[..., RealRobot], tmp_path: Path
) -> None:
    folder = tmp_path / "boxes"
    # A ring that another test left behind would be saved first, and ours a minute later.
    environ = {"RUNTIME_DIRECTORY": str(tmp_path / "run")}
    robot = real_robot(run=("--set", f"blackbox.folder={folder}"), environ=environ)
    await asyncio.to_thread(robot.daemon.says, "Connected to")
    served = await site(endpoint=robot.endpoint, phones=True)
    await eventually(lambda: served.hub.robot.obstacle() is None)
    viewer, driver = await served.page("viewer"), await served.page()
    await viewer.send(type="estop", id=1)
    assert (await viewer.one("answer", id=1))["ok"]
    await eventually(lambda: list(folder.glob("*_estop*.blackbox")))

    async def get(path: str, role: str = "viewer") -> tuple[int, bytes]:
        cookie = served.cookie(role) if role else {}
        status, _, body = await served.request("GET", path, **cookie)
        return status, body

    assert [(await get(path, role=""))[0] for path in ("/boxes", "/boxes/1", "/boxes/1/words")] == [
        401
    ] * 3
    status, body = await get("/boxes")
    assert status == 200
    (saved,) = folder.glob("*_estop*.blackbox")
    (box,) = [each for each in json.loads(body)["boxes"] if each["name"] == saved.stem]
    status, body = await get(f"/boxes/{box['name']}/words")
    story: dict[str, Any] = json.loads(body)
    assert any("mergency stop" in line["words"] for line in story["lines"])
    status, body = await get(f"/boxes/{box['name']}")
    assert body == saved.read_bytes()
    assert read_box(body).records
    assert (await get("/boxes/..%2fsecret"))[0] == 404
    assert (await get("/boxes/nothing/words"))[0] == 404

    await viewer.send(type="tool", id=2, do="save_box", args={})
    assert not (await viewer.one("answer", id=2))["ok"]
    await driver.send(type="tool", id=3, do="save_box", args={})
    answer = await driver.one("answer", id=3)
    assert answer["ok"], answer


@pytest.mark.nightly
async def test_without_a_daemon_nothing_is_saved_and_the_reason_is_named(tmp_path: Path) -> None:
    options = [f"--connect={free_endpoint()}"]
    boxes = PageBoxes(StillClock(), options)  # type: ignore[arg-type]
    done, words = await boxes.save()
    assert not done
    assert words
