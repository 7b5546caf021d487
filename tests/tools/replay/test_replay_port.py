from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from process_priority import BOARD_NICE, DAEMON_NICE, prefer
from real_robot import Client, Process, wait_for
from wire_records import WireBench, drive_about, save
from zenoh_fixtures import free_endpoint

from yahboomd.blackbox.box_file import read_box
from yahboomd.core.config import Config
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.virtual_time import run as run_on_virtual_time
from yahboomd.tools.replay.replay_port import as_configured_says

pytestmark = pytest.mark.realtime


def recorded(folder: Path, dialect: str) -> tuple[Path, WireBench]:
    """A black box of a short drive."""

    async def drive() -> WireBench:
        # Far from zero, so that on a busy machine no late line looks like a reset.
        ticks = (100_000, 200_000, 300_000, 400_000)
        async with WireBench(folder, dialect, initial_ticks=ticks) as bench:
            await drive_about(bench)
        return bench

    bench = run_on_virtual_time(drive())
    save(folder / "box", bench)
    return folder / "box", bench


@pytest.mark.nightly
@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled", "rosmaster"])
def test_a_real_daemon_takes_the_recording_for_the_board_and_ends_where_the_robot_did(
    tmp_path: Path, client: Callable[..., Client], dialect: str
) -> None:
    box, bench = recorded(tmp_path, dialect)
    link, endpoint = tmp_path / "board", free_endpoint()
    board = Process("replay", str(box), "--link", str(link), "--json")
    prefer(board.process, BOARD_NICE)
    try:
        board.says("a daemon opens it")
        daemon = Process(
            *("run", "--port", str(link), "--set", f'zenoh.listen=["{endpoint}"]'),
            *("--set", "zenoh.connect=[]", "--set", f"estop.latch_file={tmp_path / 'estop2'}"),
            *("--set", "faults.turns_without_command=report"),
        )
        prefer(daemon.process, DAEMON_NICE)
        try:
            watching = client("client", endpoint)
            wait_for(lambda: board.process.poll() is not None, "the recording is over")
            there = bench.heard.estimates[-1].pose

            def same() -> bool:
                # Samples may still be on their way.
                here = watching.latest("pose")
                return (here["x"], here["y"], here["theta"]) == pytest.approx(
                    (there.x, there.y, there.theta), abs=0.02
                )

            wait_for(same, "the daemon's pose is that of the recording")
            assert "connected" in [each["kind"] for each in watching.samples["events"]]
        finally:
            print(daemon.output)
            daemon.end()
    finally:
        status = board.end()
    facts = json.loads(board.lines[-1])
    assert (status, facts["complete"]) == (0, True)
    # At rest a daemon repeats its stop; it had nothing to drive.
    assert facts["motions"] == 0
    assert facts["stops"] > 0
    assert not os.path.lexists(link)


def test_a_board_that_was_never_asked_answers_as_its_configuration_has_it(tmp_path: Path) -> None:
    async def drive() -> WireBench:
        overrides = ("board.profile=310",)
        async with WireBench(tmp_path, "streamed", *overrides) as bench:
            await bench.until(lambda: bench.readings or bench.heard.events)
        return bench

    save(tmp_path / "box", run_on_virtual_time(drive()))
    config = Config.of(read_box((tmp_path / "box").read_bytes()).header.config)
    said = as_configured_says(config, DIALECTS["streamed"], b"$read_flash#")
    assert said.startswith(b"read_flash:OK!")
    assert b"Motor_type:2" in said
    asked = as_configured_says(
        config, DIALECTS["rosmaster"], DIALECTS["rosmaster"].read_settings[0]
    )
    assert asked.startswith(b"\xff\xfb")
    assert len(asked) == asked[2] + 2
