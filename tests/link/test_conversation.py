"""Questions to a board that nothing drives."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator

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


@on_virtual_time
async def test_the_polled_board_stores_nothing_and_is_not_waited_for() -> None:
    board = LinkBench(dialect="polled")
    async with talking(board) as talk:
        start_ns = board.now_ns
        assert await talk.read_settings(WANT) is None
        assert board.now_ns == start_ns


@on_virtual_time
async def test_leaving_after_a_rest_says_nothing_more() -> None:
    board = LinkBench()
    async with talking(board) as talk:
        await talk.rest()
        said = len(board.frames)
    assert len(board.frames) == said
