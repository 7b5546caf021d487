"""The questions of commands to a board, on virtual time."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

import pytest
from board_bench import LinkBench

from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.port.board_questions import read_battery, read_counters


@contextlib.asynccontextmanager
async def talking(board: LinkBench) -> AsyncIterator[Conversation]:
    line = Line(await board.open(), board.clock)
    async with line.attended():
        yield await Conversation.begin(line)


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_counters_are_the_boards_own(dialect: str) -> None:
    board = LinkBench(dialect=dialect, initial_ticks=(7, -8, 2_000_000_000, 1))
    async with talking(board) as talk:
        assert await read_counters(talk) == (7, -8, 2_000_000_000, 1)


@on_virtual_time
async def test_counters_that_do_not_come_are_none() -> None:
    board = LinkBench()
    async with talking(board) as talk:
        board.robot.mute(board.now_ns, 60.0)
        assert await read_counters(talk) is None


@on_virtual_time
async def test_the_polled_board_has_no_voltage_and_is_not_waited_for() -> None:
    board = LinkBench(dialect="polled")
    async with talking(board) as talk:
        start_ns = board.now_ns
        assert await read_battery(talk) is None
        assert board.now_ns == start_ns
