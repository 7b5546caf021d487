"""The profile on the board before a session, where the configuration says so."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from board_bench import LinkBench
from robot_bench import RobotBench

from yahboomd.daemon.storing import storing_opener
from yahboomd.errors import BoardError
from yahboomd.model import Event
from yahboomd.protocol.settings import PROFILES
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.options import FlashContent, SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time

ON = "board.write_settings=true"
UNFIT = SimulationOptions(flash=FlashContent(motor_type=2, lines=0))


@on_virtual_time
async def test_a_board_set_up_for_other_motors_is_set_up_and_driven(tmp_path: Path) -> None:
    async with RobotBench(tmp_path, [ON], UNFIT) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.03)
        stored = [each.message for each in bench.heard.events if each.kind == "setting_stored"]
        assert [words.split()[1] for words in stored] == [
            "$mtype:1#",
            "$deadzone:1900#",
            "$mline:11#",
        ]


@on_virtual_time
async def test_unless_it_is_allowed_nothing_is_written(tmp_path: Path) -> None:
    async with RobotBench(tmp_path, [], UNFIT) as bench:
        await bench.until(lambda: bench.heard.estimates)
        await bench.drive(0.5, 0.3)
        assert bench.standing
        assert bench.controller.state()[0] == "fault"
        assert bench.robot.board.flash == UNFIT.flash  # type: ignore[attr-defined]


@on_virtual_time
async def test_what_is_stored_already_is_not_written_again(tmp_path: Path) -> None:
    async with RobotBench(tmp_path, [ON], UNFIT) as bench:
        await bench.ready()
        bench.robot.unplug(bench.clock.now_ns(), 0.3)
        await bench.until(lambda: bench.controller.state()[0] == "waiting")
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.03)
        assert bench.heard.kinds.count("setting_stored") == 3


@on_virtual_time
async def test_a_polled_board_has_nothing_to_store_and_drives(tmp_path: Path) -> None:
    async with RobotBench(tmp_path, [ON], SimulationOptions(dialect="polled")) as bench:
        await bench.ready()
        await bench.drive(1.0, 0.3)
        assert min(bench.rim_speeds) == pytest.approx(0.3, abs=0.03)
        assert bench.heard.kinds == ["connected"]


@on_virtual_time
async def test_a_value_that_the_board_does_not_take_is_told_and_the_port_opened(
    tmp_path: Path,
) -> None:
    board = LinkBench()
    board.on_write = lambda data: data.replace(b"$deadzone:1900#", b"$deadzone:19#")
    told: list[Event] = []
    opener = storing_opener(board.open, board.clock, PROFILES["520"].settings, told.append)
    port = await opener()
    assert [each.kind for each in told] == ["setting_not_stored"]
    assert "$deadzone:1900#" in told[0].message
    port.close()
    await asyncio.sleep(0)


@on_virtual_time
async def test_nothing_is_stored_while_a_wheel_turns(tmp_path: Path) -> None:
    board = LinkBench(flash=FlashContent(lines=0))
    board.on_open = lambda _times: board.robot.set_faults(
        "left", FAULTS["turning"], now_ns=board.now_ns
    )
    opener = storing_opener(board.open, board.clock, PROFILES["520"].settings, lambda _: None)
    with pytest.raises(BoardError, match="at rest only"):
        await opener()
    assert not any(frame.startswith(b"$mline") for frame in board.frames)
