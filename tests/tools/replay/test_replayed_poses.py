from __future__ import annotations

import json
import math
import random
from pathlib import Path

import pytest
from replay_captures import FOLDER, HEADINGS, golden
from wire_records import TappedOdometer, WireBench, header_of

from yahboomd.blackbox.box_file import Box, read_box
from yahboomd.blackbox.records import Anchor, Armed, ReadingRecord, Received, Record
from yahboomd.core.model import EncoderReading, Pose2d
from yahboomd.core.odometry.odometer import Update
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.replay.replayed_poses import KINDS, NEAR, PoseReplay


def replayed(bench: WireBench) -> PoseReplay:
    replay = PoseReplay(header_of(bench))
    replay.run(bench.records)
    return replay


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("dialect", "heading"), [("streamed", "wheels"), ("polled", "wheels"), ("rosmaster", "fused")]
)
@on_virtual_time
async def test_every_pose_and_every_event_of_the_odometry_is_the_daemons_to_the_last_bit(
    tmp_path: Path, dialect: str, heading: str
) -> None:
    chance = random.Random(7)
    bench = WireBench(tmp_path, dialect, f"odometry.heading={heading}")
    async with bench:
        await bench.ready()
        for disturbance in ("", "reset", "pose", "noise", "unplug", "hold", ""):
            now_ns = bench.clock.now_ns()
            bench.robot.impairments.change(corruption=0.002 * (disturbance == "noise"))
            match disturbance:
                case "reset":
                    bench.robot.reset(now_ns)
                case "pose":
                    bench.operator.set_pose(Pose2d(x=1.0, theta=math.pi), None)
                case "unplug":
                    bench.robot.unplug(now_ns, 1.0)
                case "hold":
                    bench.robot.hold(now_ns, 0.4)
            for _ in range(2):
                await bench.drive(1.0, chance.uniform(-0.3, 0.4), chance.uniform(-1.0, 1.0))
            bench.anchor(dialect)
    replay = replayed(bench)
    assert len(replay.estimates) > 200
    found = [each.estimate for each in replay.estimates]
    assert found == bench.heard.estimates[-len(found) :]
    compared = replay.compared
    assert compared.same
    assert compared.moments == compared.identical >= 1
    assert (compared.largest, compared.unmatched, compared.restarts) == (0.0, 0, 0)
    published = [each for each in bench.heard.events if each.kind in KINDS]
    assert published[-1] in replay.events


@on_virtual_time
async def test_after_records_that_are_missing_it_goes_on_from_the_daemons_next_state(
    tmp_path: Path,
) -> None:
    async with WireBench(tmp_path, "streamed") as bench:
        await bench.ready()
        await bench.drive(2.0, 0.3, 0.5)
        bench.anchor("streamed")
        resumed = len(bench.heard.estimates)
        await bench.drive(1.0, 0.2)
    (at,) = [index for index, each in enumerate(bench.records) if isinstance(each.meaning, Anchor)][
        1:
    ]
    records = [*bench.records[: at - 500], *bench.records[at:]]
    replay = PoseReplay(header_of(bench))
    replay.run(records, damaged=True)
    after = bench.heard.estimates[resumed:]
    assert [each.estimate for each in replay.estimates][-len(after) :] == after
    assert (replay.compared.restarts, replay.compared.same) == (1, True)
    # In a file that is whole the same is a difference.
    whole = PoseReplay(header_of(bench))
    whole.run(records)
    assert whole.compared.largest > 1e-3
    assert not whole.compared.same


def captured(capture: str) -> Box:
    return read_box((FOLDER / f"{capture}.box").read_bytes())


def test_the_odometer_is_called_in_the_order_in_which_the_daemon_called_it() -> None:
    replay = PoseReplay(captured("streamed").header)
    replay.run([Record(0, Anchor(port="p", byte_ns=10, dialect="streamed", state=b""))])
    calls: list[object] = []
    replay._odometer = TappedOdometer(
        replay._odometer,
        update=lambda reading: calls.append(reading) or Update(),
        armed=lambda: calls.append("armed"),
    )
    # One read brings counts, the banner of a reset, at which the daemon arms, and counts again.
    before, banner, after = b"$MAll:9,9,9,9#\r\n", b"Motor_Version:1.7.3\r\n", b"$MAll:0,0,0,0#"
    came = before + banner + after
    flags = {"after_reset": True, "after_gap": True, "unbroken": True, "earliest_ns": 40}
    replay.run(
        [
            Record(10_000, Received(data=came)),
            Record(10_001, Armed()),
            Record(10_002, ReadingRecord(received_ns=10_000, requested_ns=9_990, **flags)),
            Record(20_000, Received(data=after)),
        ]
    )
    behind = 10 * len(banner + after)
    first_ns = 10_000 - behind - 20
    assert calls == [
        EncoderReading(ticks=(9, 9, 9, 9), received_ns=first_ns, sent_ns=first_ns - 140),
        "armed",
        EncoderReading(
            ticks=(0, 0, 0, 0), received_ns=10_000, sent_ns=9_990, requested_ns=9_990, **flags
        ),
        EncoderReading(ticks=(0, 0, 0, 0), received_ns=20_000, sent_ns=20_000 - 140),
    ]


def test_a_reading_that_the_bytes_do_not_show_is_counted() -> None:
    replay = PoseReplay(captured("streamed").header)
    lost = Record(5, ReadingRecord(received_ns=4))
    replay.run([lost, Record(0, Anchor(port="p", byte_ns=1, dialect="streamed", state=b"")), lost])
    assert replay.compared.unmatched == 1
    assert not replay.compared.same


@pytest.mark.parametrize("capture", HEADINGS)
def test_a_capture_gives_its_golden_poses_and_events(capture: str) -> None:
    box = captured(capture)
    expected = json.loads((FOLDER / f"{capture}.json").read_text())
    replay = PoseReplay(box.header)
    replay.run(box.records)
    estimates = [each.estimate for each in replay.estimates]
    assert len(estimates) == expected["estimates"]
    assert [each.kind for each in replay.events] == expected["events"]
    poses = golden(estimates)
    assert [row[0] for row in poses] == [row[0] for row in expected["poses"]]
    largest = max(
        abs(here - there)
        for row, known in zip(poses, expected["poses"], strict=True)
        for here, there in zip(row[1:], known[1:], strict=True)
    )
    # On the machine that recorded them it is 0.
    assert largest <= NEAR
    assert replay.compared.same
