from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from wire_records import WireBench, drive_about

from yahboomd.blackbox.records import (
    Anchor,
    Closed,
    Identified,
    Opened,
    Received,
    Record,
    Written,
)
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.replay.recorded_wire import connections

MS = 1_000_000
FLASH = b"read_flash:OK!\r\nMotor_Version:1.7.3\r\nP:0.800\t I:0.060\t D:0.500\t \r\n"
LINE = b"$MAll:1,2,3,4#\r\n"


def read(at_ms: int, data: bytes) -> Record:
    return Record(at_ms * MS, Received(data=data))


def written(at_ms: int, data: bytes) -> Record:
    return Record(at_ms * MS, Written(data=data))


def streamed(*records: Record) -> list[Record]:
    return [
        Record(0, Opened(port="p", byte_ns=1)),
        *records,
        Record(0, Identified(dialect="streamed")),
    ]


def test_answers_leave_the_stream_whole_and_everything_else_keeps_its_moment() -> None:
    (found,) = connections(
        streamed(
            read(1, b"old" + LINE),
            written(2, b"$read_flash#"),
            read(5, FLASH[:20]),
            read(7, FLASH[20:]),
            written(10, b"$upload:1,0,0#"),
            read(20, LINE + b"$MAll:2,"),
            written(21, b"$read_vol#"),
            read(30, b"2,3,4#\r\n$Battery:7.40V#\r\n" + LINE),
            written(40, b"$spd:1,1,1,1#"),
            read(41, b"Set mline:OK!\r\n"),
        )
    )
    assert found.begins_ns == 10 * MS
    assert [(each.at_ns // MS, each.data, each.whole) for each in found.stream] == [
        (20, LINE + b"$MAll:2,", False),
        (30, b"2,3,4#\r\n\r\n" + LINE, True),
        (41, b"Set mline:OK!\r\n", True),
    ]
    (flash,) = found.answers[b"$read_flash#"]
    assert b"".join(each.data for each in flash) == FLASH
    assert [each.at_ns // MS for each in flash] == [3, 5, 5]
    assert [
        [(each.at_ns // MS, each.data) for each in one] for one in found.answers[b"$read_vol#"]
    ] == [[(9, b"$Battery:7.40V#")]]


def test_connections_are_separate_and_one_without_a_board_is_left_out() -> None:
    opened, closed = Record(0, Opened(port="p", byte_ns=1)), Record(9, Closed())
    anchor = Record(0, Anchor(port="p", byte_ns=1, dialect="rosmaster", state=b""))
    found = connections(
        [
            *(anchor, read(1, b"middle"), closed),
            *(opened, written(2, b"$read_flash#"), closed),
            *(opened, written(3, b"$read#"), read(4, b"$data:1,2,3,4#")),
            Record(5, Identified(dialect="polled")),
        ]
    )
    assert [each.dialect.name for each in found] == ["rosmaster", "polled"]
    assert [each.data for each in found[0].stream] == [b"middle"]
    assert [(poll.at_ns, [p.data for p in poll.answer]) for poll in found[1].polls] == [
        (3 * MS, [b"$data:1,2,3,4#"])
    ]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "polled", "rosmaster"])
@on_virtual_time
async def test_no_byte_of_a_drive_is_lost(tmp_path: Path, dialect: str) -> None:
    async with WireBench(tmp_path, dialect) as bench:
        await drive_about(bench)
    (found,) = connections(bench.records)
    came = [each for each in bench.records if isinstance(each.meaning, Received)]
    size = sum(len(each.meaning.data) for each in came if each.at_ns >= found.begins_ns)  # type: ignore[union-attr]
    answers = [piece for every in found.answers.values() for answer in every for piece in answer]
    polled = [piece for poll in found.polls for piece in poll.answer]
    kept = sum(len(each.data) for each in (*found.stream, *polled))
    late = sum(len(each.data) for each in answers)
    assert kept <= size <= kept + late
    assert found.poll_gap_ns == pytest.approx(20 * MS if polled else 0, abs=MS)
    assert all(before.at_ns <= after.at_ns for before, after in pairwise(found.stream))
