"""``yahboomd blackbox``: its output and its exit statuses, without a daemon."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from made_boxes import HEADER, saved_box

from yahboomd.blackbox.records import DecisionRecord
from yahboomd.blackbox.ring_file import RingFile
from yahboomd.blackbox.saved_boxes import save_box
from yahboomd.cli.main import main
from yahboomd.tools.blackbox import box_places

BOX = saved_box(
    (20.0, DecisionRecord(state="driving", driver="cmd_vel", why="cmd_vel drives.")),
    (12.41, DecisionRecord(state="estopped", driver="", why="Emergency stop, engaged by Ann.")),
)

Blackbox = Callable[..., tuple[int, str, str]]


@pytest.fixture
def blackbox(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Blackbox:
    """Runs the command on a machine with two saved boxes."""
    folder = tmp_path / "state" / "blackbox"
    folder.mkdir(parents=True)
    monkeypatch.setenv("STATE_DIRECTORY", str(folder.parent))
    monkeypatch.setattr("yahboomd.tools.blackbox.box_places.SERVICES", "/no/such/*")
    # Other robots may run on this machine.
    monkeypatch.setattr("yahboomd.tools.blackbox.box_places.folders", lambda environ: [])
    for reason in ("disconnected", "estop"):
        save_box(folder, BOX, reason=reason, wall_ns=1_795_370_130_000_000_000)

    def run(*arguments: str) -> tuple[int, str, str]:
        status = main(["blackbox", *arguments])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


def test_for_programs_it_lists_as_json(blackbox: Blackbox) -> None:
    for arguments in (("--json",), ("list", "--json")):
        _, out, _ = blackbox(*arguments)
        found = [each for each in json.loads(out)["boxes"] if each["kind"] == "saved"]
        assert [each["name"] for each in found] == ["1", "2"]
        assert all(Path(each["path"]).is_file() and each["bytes"] for each in found)


def test_it_explains_in_plain_words_with_times(blackbox: Blackbox) -> None:
    status, out, _ = blackbox("explain")
    assert status == 0
    assert "000002_" in out.splitlines()[0]
    assert "It stopped 12.41 s before the save: Emergency stop, engaged by Ann." in out
    assert "20.00 s before the save: driving: cmd_vel drives." in out
    _, out, _ = blackbox("explain", "1", "--json")
    facts = json.loads(out)
    assert "000001_" in facts["path"]
    assert facts["why"].startswith("It stopped 12.41 s before the save")
    assert [line["before_s"] for line in facts["lines"]] == [20.0, 12.41]
    assert facts["end"] == "2026-11-22 17:55:30.00 UTC"


def test_beside_a_daemon_it_names_the_box_that_is_not_saved_yet(
    blackbox: Blackbox, monkeypatch: pytest.MonkeyPatch
) -> None:
    def boxes(where: box_places.Places) -> list[box_places.Found]:
        robot = box_places.BoxRobot(namespace="bot1")
        ring = box_places.Found(Path("/run/blackbox-7.ring"), "7", "running", 0, 1, robot)
        return [*(each for each in found(where) if each.kind == "saved"), ring]

    found = box_places.boxes
    monkeypatch.setattr(box_places, "boxes", boxes)
    status, out, err = blackbox("explain")
    assert status == 0
    assert "000002_" in out.splitlines()[0]
    assert "blackbox explain 7`" in err


def test_it_exports_as_mcap(blackbox: Blackbox, tmp_path: Path) -> None:
    path = tmp_path / "stop.mcap"
    status, out, _ = blackbox("export", "2", str(path))
    assert (status, out) == (0, f"Wrote 2 messages to {path}.\n")
    assert path.read_bytes().startswith(b"\x89MCAP")
    status, _, err = blackbox("export", "2", str(path))
    assert status == 1
    assert "there already" in err


def box_of(namespace: str, port: str, listen: str, why: str) -> bytes:
    config = {"zenoh": {"namespace": namespace, "listen": [listen]}, "serial": {"port": port}}
    drives = DecisionRecord(state="driving", driver="cmd_vel", why="cmd_vel drives.")
    stands = DecisionRecord(state="standing", driver="", why=why)
    return saved_box((20.0, drives), (12.41, stands), config=config)


def test_of_several_robots_it_tells_the_story_of_the_one_that_the_options_name(
    blackbox: Blackbox, tmp_path: Path
) -> None:
    folder = tmp_path / "state" / "blackbox"
    for path in folder.iterdir():
        path.unlink()
    robots = {
        ("left", "/dev/ttyUSB0", "tcp/0.0.0.0:7001"): "Left stands.",
        ("right", "/dev/ttyUSB1", "tcp/127.0.0.1:7002"): "Right stands.",
        ("", "/dev/ttyUSB2", "tcp/127.0.0.1:7003"): "The other stands.",
    }
    for number, (robot, why) in enumerate(robots.items()):
        save_box(folder, box_of(*robot, why), reason="estop", wall_ns=10**18 + number)
    for words, whose in {
        ("--namespace", "left"): "Left",
        ("--set", "zenoh.namespace=right"): "Right",
        ("--connect", "tcp/127.0.0.1:7001"): "Left",
        ("--connect", "tcp/127.0.0.1:7002"): "Right",
        ("--port", "/dev/ttyUSB2"): "The other",
        ("--namespace", ""): "The other",
    }.items():
        status, out, err = blackbox("explain", *words)
        assert status == 0
        assert f"{whose} stands." in out
        # Whose it is, and how to ask for the others.
        namespace, port, _ = next(key for key, why in robots.items() if why.startswith(whose))
        assert f"{f'robot {namespace}, ' if namespace else ''}board on {port}, process" in out
        assert ("Of the robot without a namespace on /dev/ttyUSB2: " in err) == (
            whose != "The other"
        )
        _, out, _ = blackbox("list", "--json", *words)
        (listed,) = [each for each in json.loads(out)["boxes"] if each["kind"] == "saved"]
        assert port in listed["robot"]
    status, _, err = blackbox("explain", "--namespace", "third")
    assert status == 78
    assert "no black box of this robot" in err


def test_several_robots_that_run_and_no_option_is_a_question_and_no_story(
    blackbox: Blackbox, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = tmp_path / "run"
    runs.mkdir()
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(runs))
    headers = [
        msgspec.structs.replace(HEADER, config={"zenoh": {"namespace": name, "listen": [at]}})
        for name, at in (("left", "tcp/127.0.0.1:7001"), ("right", "tcp/127.0.0.1:7002"))
    ]
    rings = [RingFile(runs, header) for header in headers]
    assert sorted(path.name.rpartition("-")[0] for path in runs.iterdir()) == [
        "blackbox-left",
        "blackbox-right",
    ]
    status, out, err = blackbox("explain")
    assert (status, out) == (78, "")
    assert "`--namespace left`: robot left; `--namespace right`: robot right" in err
    for ring in rings:
        ring.close(keep=False)
