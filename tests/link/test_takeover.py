"""A board that drives on after its daemon was killed is brought to rest, whatever is wrong."""

from __future__ import annotations

import asyncio

import pytest
from board_bench import LinkBench

from yahboomd.core.link.takeover import TakeoverReport, take_over
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.options import ImpairmentOptions
from yahboomd.simulation.virtual_time import on_virtual_time

DIALECTS = ["streamed", "polled"]


async def taken_over(board: LinkBench) -> TakeoverReport:
    return await take_over(await board.open(), board.clock)


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_wheels_that_turn_after_a_crash_come_to_rest_and_are_seen_to(dialect: str) -> None:
    board = LinkBench(dialect=dialect)
    await board.drive()
    assert min(board.rim_speeds) > 0.2
    report = await taken_over(board)
    assert max(map(abs, board.rim_speeds)) < 0.03
    assert report.dialect == dialect
    assert report.stood is True
    assert report.within_s < 0.6
    assert board.ports[-1].closed


@on_virtual_time
async def test_a_stop_that_was_said_already_is_not_said_again_before_the_question() -> None:
    board = LinkBench()
    await board.drive()
    began_ns = board.now_ns - 100_000_000
    report = await take_over(await board.open(), board.clock, spoken_ns=began_ns)
    # Its stream identifies it: the first frame is the brake of a known board.
    assert board.frames[0] == b"$spd:0,0,0,0#"
    assert report.within_s > 0.1


@on_virtual_time
async def test_it_leaves_with_the_motors_let_go_and_the_stream_off() -> None:
    board = LinkBench()
    await board.drive()
    await taken_over(board)
    assert board.frames[-3:] == [b"$pwm:0,0,0,0#", b"$upload:0,0,0#", b"$pwm:0,0,0,0#"]
    board.robot.advance(board.now_ns)
    assert board.robot.board.streams == (False, False, False)  # type: ignore[attr-defined]
    assert all(motor.pwm == 0 for motor in board.robot.plant.motors)


@pytest.mark.cases(3)
@pytest.mark.parametrize("fault", ["encoder-dead", "encoder-reversed", "phases-swapped"])
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_runaway_wheel_is_stopped(dialect: str, fault: str) -> None:
    board = LinkBench(dialect=dialect)
    await board.open()
    board.robot.set_faults("left", FAULTS[fault], now_ns=board.now_ns)
    board.ports.pop().close()
    await board.drive()
    assert max(map(abs, board.rim_speeds)) > 0.9
    await taken_over(board)
    await asyncio.sleep(0.5)
    assert max(map(abs, board.rim_speeds)) < 0.03


@pytest.mark.parametrize("fault", ["encoder-reversed", "phases-swapped"])
@on_virtual_time
async def test_a_wheel_that_the_brake_makes_faster_is_cut_long_before_the_patience_ends(
    fault: str,
) -> None:
    board = LinkBench()
    await board.open()
    board.robot.set_faults("left", FAULTS[fault], now_ns=board.now_ns)
    board.ports.pop().close()
    await board.drive()
    port = await board.open()
    report = await take_over(port, board.clock)
    brakes = [at_ns for at_ns, data in port.written if b"$spd:0" in data]
    cuts = [at_ns for at_ns, data in port.written if b"$pwm:0" in data and at_ns > brakes[0]]
    assert cuts[0] - brakes[0] < 300_000_000
    assert report.stood is True
    assert report.cut


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_wheel_that_something_else_turns_is_not_reported_as_standing(dialect: str) -> None:
    board = LinkBench(dialect=dialect)
    await board.open()
    board.robot.set_faults("left", FAULTS["turning"], now_ns=board.now_ns)
    board.ports.pop().close()
    report = await taken_over(board)
    assert report.stood is False
    assert report.within_s < 4.0


@on_virtual_time
async def test_a_board_that_hangs_is_sent_another_stop_and_reported_as_unseen() -> None:
    board = LinkBench()
    await board.drive()
    board.robot.hang(board.now_ns)
    start_ns = board.now_ns
    report = await taken_over(board)
    assert (report.dialect, report.stood) == (None, None)
    assert report.heard.start == b""
    assert board.frames.count(b"$pwm:0,0,0,0#") >= 3
    assert board.now_ns - start_ns < 4_000_000_000


@on_virtual_time
async def test_a_board_that_listens_and_cannot_be_heard_stops() -> None:
    board = LinkBench()
    await board.drive()
    board.robot.mute(board.now_ns, 60.0)
    report = await taken_over(board)
    assert report.stood is None
    assert max(map(abs, board.rim_speeds)) < 0.03


@on_virtual_time
async def test_a_board_that_is_deaf_while_it_writes_its_flash_is_stopped_afterwards() -> None:
    board = LinkBench()
    await board.drive()
    port = await board.open()
    port.write(b"$mline:12#")
    await asyncio.sleep(0.005)
    port.close()
    report = await taken_over(board)
    assert report.stood is True
    assert max(map(abs, board.rim_speeds)) < 0.03


@pytest.mark.cases(3)
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_line_that_loses_every_fiftieth_byte_does_not_keep_the_wheels_turning(
    dialect: str, seed: int
) -> None:
    board = LinkBench(dialect=dialect, seed=seed, impairments=ImpairmentOptions(loss=0.02))
    while not board.ports or min(board.rim_speeds) < 0.2:
        await board.drive()
    await taken_over(board)
    assert max(map(abs, board.rim_speeds)) < 0.03


@on_virtual_time
async def test_long_lines_that_spoil_what_the_board_hears_do_not_keep_it_driving() -> None:
    board = LinkBench(initial_ticks=(-(2**31) + 5000,) * 4)
    while not board.ports or min(board.rim_speeds) < 0.2:
        await board.drive()
    report = await taken_over(board)
    assert report.stood is True
    assert max(map(abs, board.rim_speeds)) < 0.03


@on_virtual_time
async def test_half_a_frame_in_the_boards_ear_does_not_swallow_the_stop() -> None:
    board = LinkBench()
    await board.drive()
    port = await board.open()
    port.write(b"$spd:900,0,9")
    await asyncio.sleep(0.01)
    port.close()
    began_ns = board.now_ns
    port = await board.open()
    stopping = asyncio.create_task(take_over(port, board.clock))
    await asyncio.sleep(0.02)
    assert board.now_ns - began_ns < 25_000_000
    assert all(motor.pwm == 0 for motor in board.robot.plant.motors)
    await stopping
