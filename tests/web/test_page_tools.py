"""A page uses tools by name, and everything ends with the server."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest
from real_robot import RealRobot
from web_site import Site
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.client.connection import ENDPOINT, client_options
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import read
from yahboomd.web.page_session import Tool
from yahboomd.web.page_tools import PageTools, ToolSettings


@pytest.mark.parametrize(
    ("do", "args"),
    [
        ("nothing", {}),
        ("", {}),
        ("calibrate", {}),
        ("calibrate", {"verb": "tape"}),
        ("calibrate", {"verb": "tape", "choices": [1]}),
        ("calibrate", {"verb": "undo", "choices": {}}),
        ("answer", {"question": "a", "text": "1"}),
        ("answer", {"question": 1, "text": 1}),
        ("end_calibration", {}),
        ("end_recording", {}),
        ("delete_recording", {}),
        ("delete_recording", {"name": "../x"}),
    ],
)
async def test_what_makes_no_sense_is_refused_in_words(
    tmp_path: Path, do: str, args: dict[str, Any]
) -> None:
    settings = ToolSettings(robot=(), recordings=tmp_path, load=lambda: read(None, environ={}))
    tools = PageTools(
        client_options(ENDPOINT), SystemClock(), settings, "cmd_vel/web", lambda _: None
    )
    done, words = await tools.use(1, Tool(id=1, do=do, args=args))
    assert not done
    assert words.endswith(".")


@pytest.mark.realtime
async def test_a_robot_that_cannot_drive_is_not_calibrated(
    site: Callable[..., Awaitable[Site]],
) -> None:
    served = await site(endpoint=free_endpoint())
    page = await served.page()
    await page.send(type="tool", id=1, do="calibrate", args={"verb": "tape", "choices": {}})
    assert not (await page.one("answer", id=1))["ok"]
    assert served.hub.tools.calibration.page is None


@pytest.mark.nightly
@pytest.mark.realtime
@pytest.mark.xdist_group("web_tools")
async def test_recorder_and_wizard_end_with_the_server(
    site: Callable[..., Awaitable[Site]], real_robot: Callable[..., RealRobot], tmp_path: Path
) -> None:
    robot = real_robot()
    await asyncio.to_thread(robot.daemon.says, "Connected to")
    served = await site(endpoint=robot.endpoint)
    await eventually(lambda: served.hub.robot.obstacle() is None)
    page = await served.page()
    tools, folder = served.hub.tools, tmp_path / "recordings"
    await page.send(type="tool", id=1, do="calibrate", args={"verb": "tape", "choices": {}})
    assert (await page.one("answer", id=1))["ok"]
    async with asyncio.timeout(300.0):
        while not (parts := list(folder.glob("*/native_0.mcap"))):
            # On a busy machine a recorder may report that it did not reach the daemon in time.
            await tools.recordings.begin()
            await asyncio.sleep(0.1)
    await tools.close()
    assert (tools.calibration.page, tools.recordings.running) == (None, False)
    # It is written when a recording ends in order.
    assert parts[0].with_name("metadata.yaml").exists()
