"""``yahboomd blackbox``: what it prints, and its exit statuses, without a daemon."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from made_boxes import saved_box
from zenoh_fixtures import free_endpoint

from yahboomd.blackbox.records import Decision
from yahboomd.blackbox.saved_boxes import save_box
from yahboomd.cli.blackbox import box_places
from yahboomd.cli.main import main

BOX = saved_box(
    (20.0, Decision(state="driving", driver="cmd_vel", why="cmd_vel drives.")),
    (12.41, Decision(state="estopped", driver="", why="Emergency stop, engaged by Ann.")),
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
    monkeypatch.setattr("yahboomd.cli.blackbox.box_places.SERVICES", "/no/such/*")
    for reason in ("disconnected", "estop"):
        save_box(folder, BOX, reason=reason, wall_ns=1_795_370_130_000_000_000)

    def run(*arguments: str) -> tuple[int, str, str]:
        status = main(["blackbox", *arguments])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


@pytest.mark.parametrize("verb", [(), ("list",)])
def test_it_lists_what_was_saved(blackbox: Blackbox, verb: tuple[str, ...]) -> None:
    status, out, _ = blackbox(*verb)
    lines = [line.split() for line in out.splitlines() if ".ring" not in line]
    assert status == 0
    assert [(words[0], words[3]) for words in lines] == [("1", "disconnected"), ("2", "estop")]


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


def test_it_says_that_a_file_was_cut_off(blackbox: Blackbox, tmp_path: Path) -> None:
    path = tmp_path / "copied.blackbox"
    path.write_bytes(BOX[:-20])
    _, out, _ = blackbox("explain", str(path))
    assert "the file was cut off: its end is missing" in out
    _, out, _ = blackbox("explain", "1")
    assert "cut off" not in out


def test_beside_a_daemon_it_names_the_box_that_is_not_saved_yet(
    blackbox: Blackbox, monkeypatch: pytest.MonkeyPatch
) -> None:
    def boxes(where: box_places.Places) -> list[box_places.Found]:
        ring = box_places.Found(Path("/run/blackbox-7.ring"), "7", "running", 0, 1)
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


def test_a_file_larger_than_memory_is_refused(blackbox: Blackbox, tmp_path: Path) -> None:
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(1 << 40)
    for words in (("explain", "huge"), ("export", "huge", "x.mcap")):
        status, _, err = blackbox(words[0], *(str(tmp_path / word) for word in words[1:]))
        assert status == 78
        assert "it is larger than any" in err
    assert not (tmp_path / "x.mcap").exists()


def test_what_is_not_there_is_refused(blackbox: Blackbox, tmp_path: Path) -> None:
    status, _, err = blackbox("explain", "7")
    assert status == 78
    assert "`yahboomd blackbox`" in err.replace(".venv/bin/", "")
    status, _, err = blackbox("save", "--connect", free_endpoint(), "--timeout", "0.2")
    assert status == 69
