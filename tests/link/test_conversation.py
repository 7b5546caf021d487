"""Questions to a board that nothing drives."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

import pytest
from board_bench import LinkBench

from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.virtual_time import on_virtual_time

WANT = PROFILES["520"].settings


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
        assert await talk.read_counters() == (7, -8, 2_000_000_000, 1)


@on_virtual_time
async def test_counters_that_do_not_come_are_none() -> None:
    board = LinkBench()
    async with talking(board) as talk:
        board.robot.mute(board.now_ns, 60.0)
        assert await talk.read_counters() is None


@on_virtual_time
async def test_the_polled_board_has_neither_and_is_not_waited_for() -> None:
    board = LinkBench(dialect="polled")
    async with talking(board) as talk:
        start_ns = board.now_ns
        assert await talk.read_settings(WANT) is None
        assert await talk.read_battery() is None
        assert board.now_ns == start_ns


@on_virtual_time
async def test_leaving_after_a_rest_says_nothing_more() -> None:
    board = LinkBench()
    async with talking(board) as talk:
        await talk.rest()
        said = len(board.frames)
    assert len(board.frames) == said
