"""A board that takes commands, and what it makes known."""

from __future__ import annotations

import asyncio

import pytest
from board_bench import Bench

from yahboomd.link.noise import NOISY_DAMAGES
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.virtual_time import on_virtual_time


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_a_command_turns_the_wheels(dialect: str) -> None:
    async with Bench(SimulationOptions(dialect=dialect)) as board:
        await board.connected()
        board.wheels.drive((200, 0, -200, 0))
        await board.until(lambda: board.rim_speeds[0] > 0.15 and board.rim_speeds[1] < -0.15)


@on_virtual_time
async def test_a_board_that_resets_is_noticed_and_armed_again() -> None:
    async with Bench() as board:
        await board.connected()
        board.robot.reset(board.now_ns())
        await board.until(lambda: board.recorder.resets)
        count = len(board.recorder.readings)
        await board.until(lambda: len(board.recorder.readings) > count + 10)
        assert board.recorder.readings[count].after_reset
        assert sum(each.after_reset for each in board.recorder.readings) == 1


@on_virtual_time
async def test_the_listener_hears_of_the_end_once_the_brake_is_on_the_wire() -> None:
    board = Bench()
    said: list[bytes] = []

    def leaving() -> None:
        assert board.port is not None
        said.extend(board.port.frames[frames:])

    board.recorder.leaving = leaving  # type: ignore[method-assign]
    async with board:
        await board.connected()
        assert board.port is not None
        frames = len(board.port.frames)
    assert b"$spd:0,0,0,0#" in said
    assert b"$pwm:0,0,0,0#" not in said


@on_virtual_time
async def test_on_a_noisy_line_a_speed_is_repeated_more_often_until_the_noise_is_over() -> None:
    async with Bench() as board:
        await board.connected()
        assert board.port is not None
        board.wheels.drive((300, 0, 300, 0))

        async def sent_in_a_second() -> int:
            before = board.session.facts().get("velocities_sent", 0)
            await asyncio.sleep(1.0)
            return board.session.facts().get("velocities_sent", 0) - before

        assert await sent_in_a_second() <= 11
        for _ in range(NOISY_DAMAGES):
            assert not board.wheels.noisy
            board.port._memory.on_data(b"$MAll:1,$")
        assert (board.wheels.damages, board.wheels.noisy) == (NOISY_DAMAGES, True)
        assert await sent_in_a_second() >= 25
        await asyncio.sleep(9.1)
        assert (board.wheels.damages, board.wheels.noisy) == (0, False)
        assert await sent_in_a_second() <= 11
