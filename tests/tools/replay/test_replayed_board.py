from __future__ import annotations

import asyncio
import itertools
from pathlib import Path

import pytest
from board_bench import Recorder
from replay_captures import FOLDER, HEADINGS
from wire_records import DevicePort, WireBench, drive_about

from yahboomd.blackbox.box_file import read_box
from yahboomd.core.link.session import Session, SessionOptions
from yahboomd.core.model import EncoderReading
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.replay.recorded_wire import Piece, WireRecord, connections
from yahboomd.tools.replay.replayed_board import LAST_WORDS_NS, UNPLUGGED_NS, ReplayedBoard
from yahboomd.tools.replay.replayed_poses import PoseReplay

MS = 1_000_000
ARM = b"$upload:1,0,0#"


def never(_dialect: object, question: bytes) -> bytes:
    raise AssertionError(question)


async def played(
    recorded: list[WireRecord], options: SessionOptions
) -> tuple[ReplayedBoard, Recorder]:
    """A session with the recorded board, until the recording ends."""
    board, recorder, ended = ReplayedBoard(recorded, never), Recorder(), asyncio.Event()

    async def opened() -> DevicePort:
        port = DevicePort(board)
        board.host_is_there(True)
        return port

    board.on_end = ended.set
    running = asyncio.create_task(Session(opened, LoopClock(), recorder, options).run())
    over = asyncio.create_task(ended.wait())
    await asyncio.wait({running, over}, return_when=asyncio.FIRST_COMPLETED)
    for task in (running, over):
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
    return board, recorder


def since_the_first(readings: list[EncoderReading]) -> list[tuple[int, tuple[int, ...]]]:
    first_ns = readings[0].received_ns
    return [(each.received_ns - first_ns, each.ticks) for each in readings]


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", ["streamed", "rosmaster"])
@on_virtual_time
async def test_a_session_knows_the_board_and_gets_every_reading_as_long_after_the_first_as_it_was(
    tmp_path: Path, dialect: str
) -> None:
    async with WireBench(tmp_path, dialect) as bench:
        await drive_about(bench)
    board, recorder = await played(connections(bench.records), SessionOptions())
    assert [each.dialect.name for each in recorder.identities] == [dialect]
    there, here = since_the_first(bench.readings), since_the_first(recorder.readings)
    assert [ticks for _, ticks in here] == [ticks for _, ticks in there]
    assert max(abs(a - b) for (a, _), (b, _) in zip(here, there, strict=True)) < MS
    assert len(recorder.volts) == len(bench.heard.volts) > 0
    assert board.counters["questions"] > 0


@on_virtual_time
async def test_a_board_that_is_asked_answers_each_poll_with_the_answer_of_its_time(
    tmp_path: Path,
) -> None:
    async with WireBench(tmp_path, "polled") as bench:
        await drive_about(bench)
    recorded = connections(bench.records)
    _, recorder = await played(recorded, SessionOptions())
    there, here = since_the_first(bench.readings), since_the_first(recorder.readings)
    # Behind the last recorded poll the wheels stand, and so do the counters.
    assert [ticks for _, ticks in here[: len(there)]] == [ticks for _, ticks in there]
    took_ns = [
        (a.received_ns - a.requested_ns, b.received_ns - b.requested_ns)
        for a, b in zip(bench.readings, recorder.readings, strict=False)
        if a.requested_ns is not None and b.requested_ns is not None
    ]
    assert len(took_ns) > 150
    assert max(abs(a - b) for a, b in took_ns) < MS
    # At twice the rate each answer comes twice, and the counts keep their time.
    _, faster = await played(recorded, SessionOptions(poll_rate_hz=100.0))
    truth = dict(there)
    moments = sorted(truth)
    for at_ns, ticks in since_the_first(faster.readings):
        near = [truth[each] for each in moments if abs(each - at_ns) <= 21 * MS]
        assert ticks in near or at_ns > moments[-1]


def simple(*pieces: Piece, dialect: str = "streamed", **fields: object) -> WireRecord:
    given: dict[str, object] = {"answers": {}, "polls": [], "begins_ns": 0}
    given["ends_ns"] = pieces[-1].at_ns if pieces else 0
    return WireRecord(dialect=DIALECTS[dialect], stream=list(pieces), **(given | fields))  # type: ignore[arg-type]


def run_to(board: ReplayedBoard, ns: int, step_ns: int = MS) -> list[bytes]:
    first_ns = board._now_ns
    return list(
        itertools.chain.from_iterable(board.host_reads(at) for at in range(first_ns, ns, step_ns))
    )


def test_commands_for_the_wheels_are_counted_and_turn_nothing_however_they_are_cut() -> None:
    board = ReplayedBoard([simple(Piece(0, b"$MAll:1,2,3,4#\r\n"))], never)
    sent = b"\n\n$spd:1,-2,3,4#$spd:500,0,0,0#$spd:0,0,0,0#$pwm:0,0,0,0#$upload:0,0,0#"
    board.host_wrote(sent, 0)
    assert (board.counters["motions"], board.counters["stops"]) == (2, 2)
    for at in range(len(sent)):
        board.host_wrote(sent[at : at + 1], 0)
    # A stop that is not whole yet looks like a motion.
    assert board.counters["motions"] + board.counters["stops"] == 8
    assert run_to(board, 50 * MS) == []


def test_the_stream_begins_when_it_is_asked_for_and_an_answer_waits_for_the_end_of_a_line() -> None:
    pieces = [Piece(0, b"$MAll:1,", whole=False), Piece(20 * MS, b"2,3,4#\r\n")]
    answers = {b"$read_vol#": [[Piece(5 * MS, b"$Battery:7.40V#\r\n")]]}
    board = ReplayedBoard([simple(*pieces, answers=answers)], never)
    assert run_to(board, 100 * MS) == []
    board.host_wrote(ARM, 100 * MS)
    board.host_wrote(b"$read_vol#", 101 * MS)
    assert run_to(board, 119 * MS) == [b"$MAll:1,"]
    assert run_to(board, 125 * MS) == [b"2,3,4#\r\n", b"$Battery:7.40V#\r\n"]


def test_a_host_that_comes_back_gets_the_recording_from_its_beginning() -> None:
    board = ReplayedBoard([simple(Piece(0, b"a"), Piece(50 * MS, b"b"))], never)
    board.host_is_there(True)
    board.host_wrote(ARM, 0)
    assert run_to(board, 20 * MS) == [b"a"]
    assert board.elapsed_ns == 19 * MS
    board.host_is_there(False)
    assert run_to(board, 200 * MS) == []
    assert (board.elapsed_ns, board.farthest_ns) == (0, 19 * MS)
    board.host_is_there(True)
    board.host_wrote(ARM, 200 * MS)
    assert run_to(board, 260 * MS) == [b"a", b"b"]


def test_between_two_connections_the_port_goes_away_and_after_the_last_it_ends() -> None:
    board = ReplayedBoard([simple(Piece(0, b"a")), simple(Piece(0, b"b"))], never)
    plugs: list[bool] = []
    ends: list[int] = []
    board.on_plug, board.on_end = plugs.append, lambda: ends.append(1)
    board.host_wrote(ARM, 0)
    assert run_to(board, LAST_WORDS_NS + 5 * MS) == [b"a"]
    assert plugs == [False]
    assert run_to(board, LAST_WORDS_NS + UNPLUGGED_NS + 10 * MS) == []
    assert (plugs, ends) == ([False, True], [])
    board.host_wrote(ARM, board._now_ns)
    assert run_to(board, board._now_ns + LAST_WORDS_NS + 5 * MS) == [b"b"]
    assert (len(ends), board.counters["connections"]) == (1, 2)


@pytest.mark.cases(1)
@pytest.mark.parametrize("capture", HEADINGS)
@on_virtual_time
async def test_a_capture_is_a_board_that_a_session_knows_and_reads(capture: str) -> None:
    box = read_box((FOLDER / f"{capture}.box").read_bytes())
    recorded = connections(box.records)
    assert len(recorded) == (2 if capture == "polled" else 1)
    replay = PoseReplay(box.header)
    replay.run(box.records)
    _, recorder = await played(recorded[-1:], SessionOptions())
    assert [each.dialect.name for each in recorder.identities] == [capture]
    last = replay.estimates[-1].estimate.motor_ticks
    ticks = recorder.readings[-1].ticks
    moved = [ticks[motor.position - 1] for motor in box.header.odometer.motors]
    assert len(moved) == len(last)
    assert any(moved)
    assert len(recorder.resets) == (capture != "polled")
