"""The black box of a real daemon: killed at any moment, stopped for any reason, read without it."""

from __future__ import annotations

import json
import os
import random
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from real_robot import Client, RealRobot, wait_for

from yahboomd.blackbox.box_file import read_box
from yahboomd.blackbox.ring_file import ring_folder, rings
from yahboomd.blackbox.saved_boxes import SavedBox, saved_boxes
from yahboomd.tools.replay.replayed_poses import PoseReplay

pytestmark = pytest.mark.realtime


class Folders:
    """The runtime and the state directory of one robot."""

    def __init__(self, folder: Path) -> None:
        runtime = folder / "run"
        self.environ = {
            "RUNTIME_DIRECTORY": str(runtime),
            "STATE_DIRECTORY": str(folder / "state"),
        }
        self.state = folder / "state" / "blackbox"
        self._runtime = runtime

    @property
    def rings(self) -> list[Path]:
        return rings(ring_folder(self._runtime, os.getuid()))

    @property
    def saved(self) -> list[SavedBox]:
        return saved_boxes(self.state)

    @property
    def kinds(self) -> list[str]:
        """The kinds of boxes in the list, without those that this machine's services saved."""
        own = {str(path) for path in (*self.rings, *(box.path for box in self.saved))}
        return [each["kind"] for each in self.command()["boxes"] if each["path"] in own]

    def command(self, *arguments: str) -> Any:
        """What ``yahboomd blackbox ... --json`` prints."""
        ran = subprocess.run(
            [sys.executable, "-m", "yahboomd", "blackbox", *arguments, "--json"],
            env={**os.environ, **self.environ},
            capture_output=True,
            text=True,
            check=True,
        )
        return json.loads(ran.stdout)


@pytest.fixture
def folders(tmp_path: Path) -> Folders:
    return Folders(tmp_path)


def test_killed_at_any_moment_it_is_readable_and_its_poses_are_those_that_were_published(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], folders: Folders
) -> None:
    chance = random.Random(5)
    robot = real_robot(environ=folders.environ)
    application = client("client", robot.endpoint)
    application.in_state("standing")
    application.drive_until(
        b'{"vx": 0.3, "wz": 0.5}',
        lambda: (
            len(application.samples.get("pose", ())) > 25
            and application.latest("status")["state"] == "driving"
        ),
        "it drives and publishes",
    )
    time.sleep(chance.uniform(0.0, 0.05))
    robot.daemon.process.kill()
    robot.daemon.end_by_itself()
    left = folders.rings[-1]
    box = read_box(left.read_bytes())
    assert box.damaged == 0
    kinds = {type(record.meaning).__name__ for record in box.records}
    assert {
        "Anchor",
        "Received",
        "Written",
        "CommandRecord",
        "DecisionRecord",
        "Happened",
    } <= kinds
    # All that the daemon published since the first anchor, to the last bit.
    replay = PoseReplay(box.header)
    replay.run(box.records, damaged=box.damaged > 0)
    poses = [each.estimate.pose for each in replay.estimates]
    computed = {(each.x, each.y, each.theta) for each in poses}
    assert replay.compared.same
    published = [(p["x"], p["y"], p["theta"]) for p in application.samples["pose"]]
    assert len(published) > 20
    assert {*published} <= computed
    # Without a daemon. On a machine that starved the board, an own box is there, too.
    assert folders.kinds[-1] == "left"
    story = folders.command("explain", left.stem.removeprefix("blackbox-"))
    # A starved board may have stopped it before.
    assert story["why"].startswith("It drives to the end of the record.")
    application.close()
    robot.start_daemon()

    def killed() -> SavedBox | None:
        reasons = {box: read_box(box.path.read_bytes()).header.saved for box in folders.saved}
        return next((box for box, saved in reasons.items() if saved.reasons == ("killed",)), None)

    # It may have to wait for a minute after an own one.
    saved = wait_for(killed, "it is saved by the next start", 120.0)
    assert stat.S_IMODE(saved.path.stat().st_mode) == 0o640


@pytest.mark.nightly
def test_an_emergency_stop_and_a_lost_board_are_saved_and_explained_with_times(
    real_robot: Callable[..., RealRobot], client: Callable[..., Client], folders: Folders
) -> None:
    robot = real_robot(environ=folders.environ)
    application = client("client", robot.endpoint)
    application.in_state("standing")
    application.drive_until(
        b'{"vx": 0.3}',
        lambda: application.latest("status")["state"] == "driving",
        "it drives",
    )
    assert application.ask("yahboomd/estop", b'{"by": "Ann"}')["success"]
    wait_for(lambda: folders.saved, "the emergency stop is saved")
    story = folders.command("explain", str(folders.saved[-1].path))
    assert "estop" in story["reasons"]
    assert "Emergency stop, engaged by Ann" in story["why"]
    (engaged,) = [
        line for line in story["lines"] if line["what"] == "event" and "Ann" in line["words"]
    ]
    assert 0.9 <= engaged["before_s"] <= 10.0
    assert any("Sent to the board: brake" in line["words"] for line in story["lines"])
    status = application.latest("status")["command"]
    assert status["blackbox_recording"] == 1
    # Within the minute another reason waits for the next box, and is saved at the end of the
    # daemon or by the next one.
    robot.do("unplug")
    wait_for(
        lambda: "disconnected" in [each["kind"] for each in application.samples["events"]],
        "the loss is noticed",
    )
    assert robot.daemon.end(signal.SIGTERM) in (0, 75)
    (left,) = folders.rings
    assert folders.kinds == ["saved", "left"]
    story = folders.command("explain", left.stem.removeprefix("blackbox-"))
    assert any("went away" in line["words"] for line in story["lines"])
