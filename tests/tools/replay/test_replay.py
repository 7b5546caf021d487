"""The command: its output, its files, and its refusals."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import msgspec
import pytest
from wire_records import WireBench, drive_about, save

from yahboomd.blackbox.records import Happened, Received, Record
from yahboomd.cli.main import main
from yahboomd.core.model import Event
from yahboomd.simulation.virtual_time import run as run_on_virtual_time


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, WireBench]:
    """A black box of a short drive, and the daemon's samples."""
    folder = tmp_path_factory.mktemp("replay")

    async def drive() -> WireBench:
        async with WireBench(folder, "streamed") as bench:
            await drive_about(bench)
            bench.anchor("streamed")
        return bench

    bench = run_on_virtual_time(drive())
    save(folder / "drive.box", bench)
    return folder / "drive.box", bench


def test_it_says_where_the_robot_went_and_that_the_daemon_said_the_same(
    recorded: tuple[Path, WireBench], capsys: pytest.CaptureFixture[str]
) -> None:
    box, bench = recorded
    assert main(["replay", str(box), "--odometry"]) == 0
    out = capsys.readouterr().out
    last = bench.heard.estimates[-1].pose
    assert f"{len(bench.heard.estimates)} poses in " in out
    assert f"to   x {last.x:.4f} m, y {last.y:.4f} m, heading {last.theta:.4f} rad" in out
    assert "The same as the daemon's to the last bit (1 compared)." in out


def test_poses_are_written_as_a_table_and_as_json_lines_without_losing_a_bit(
    recorded: tuple[Path, WireBench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    box, bench = recorded
    table, lines = tmp_path / "poses.csv", tmp_path / "poses.jsonl"
    for output in (table, lines):
        assert main(["replay", str(box), "--odometry", "--json", "--output", str(output)]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    published = bench.heard.estimates
    assert facts["estimates"] == len(published)
    assert (facts["same"], facts["compared"]["identical"]) == (True, 1)
    assert facts["last"] == msgspec.to_builtins(published[-1].pose)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [(int(row["stamp_ns"]), float(row["x"]), float(row["theta"])) for row in rows] == [
        (each.stamp_ns, each.pose.x, each.pose.theta) for each in published
    ]
    assert [float(row["variance_theta"]) for row in rows] == [
        each.pose_covariance[8] for each in published
    ]
    read = [json.loads(line) for line in lines.read_text().splitlines()]
    assert [tuple(each["pose_covariance"]) for each in read] == [
        each.pose_covariance for each in published
    ]
    assert {each["wall_ns"] - each["stamp_ns"] for each in read} == {
        1_700_000_000_000_000_000 - bench.records[0].at_ns
    }


def test_other_poses_or_events_than_the_daemons_are_status_1(
    recorded: tuple[Path, WireBench], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, bench = recorded
    whole = bench.records
    # One read is missing, of those in which the wheels turned.
    turning = [at for at, each in enumerate(whole) if isinstance(each.meaning, Received)][400:]
    slip = Event(kind="wheels_slip", severity="info", message="The wheels slip.")
    try:
        bench.records = [*whole[: turning[0]], *whole[turning[0] + 300 :]]
        save(tmp_path / "short.box", bench)
        bench.records = [*whole, Record(whole[-1].at_ns, Happened(event=slip))]
        save(tmp_path / "slip.box", bench)
    finally:
        bench.records = whole
    assert main(["replay", str(tmp_path / "short.box"), "--odometry"]) == 1
    assert " m or rad apart." in capsys.readouterr().out
    assert main(["replay", str(tmp_path / "slip.box"), "--odometry"]) == 1
    said = capsys.readouterr().out
    assert "The daemon published, and this did not: The wheels slip." in said


@pytest.mark.parametrize(
    ("content", "status", "words"),
    [
        (None, 66, "cannot be read: No such file"),
        (b"", 65, "no black box of yahboomd"),
        (b"$MAll:1,2,3,4#", 65, "no black box of yahboomd"),
        (b"\x1f\x8b\x08broken", 65, "damaged"),
        (b"YBXBOX9\n" + bytes(100), 65, "a later version of yahboomd"),
        (b"\x89MCAP0\r\n" + bytes(100), 65, "is an MCAP file"),
        (bytes(17 << 20), 65, "it is larger than any"),
    ],
)
def test_other_files_are_refused_with_what_they_are(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    content: bytes | None,
    status: int,
    words: str,
) -> None:
    path = tmp_path / "file"
    if content is not None:
        path.write_bytes(content)
    assert main(["replay", str(path), "--odometry"]) == status
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("poses.txt", "has to end in .csv"),
        ("/nowhere/poses.csv", "cannot be written: No such file"),
    ],
)
def test_what_cannot_be_written_is_named(
    recorded: tuple[Path, WireBench], capsys: pytest.CaptureFixture[str], output: str, words: str
) -> None:
    assert main(["replay", str(recorded[0]), "--odometry", "--output", output]) == 78
    assert words in capsys.readouterr().err
