"""Questions to a board that is not driven."""

from __future__ import annotations

import asyncio

import pytest
from board_bench import LinkBench

from yahboomd.errors import BoardError, BoardSilent, PortLost
from yahboomd.link.conversation import KEPT_BYTES, Conversation
from yahboomd.protocol.profiles import PROFILES
from yahboomd.simulation.four_channel.flash import FlashContent
from yahboomd.simulation.virtual_time import on_virtual_time

DIALECTS = ["streamed", "polled"]
WANT = PROFILES["520"].settings


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_counters_are_the_boards_own(dialect: str) -> None:
    board = LinkBench(dialect=dialect, initial_ticks=(7, -8, 2_000_000_000, 1))
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        assert await talk.read_counters() == (7, -8, 2_000_000_000, 1)


@on_virtual_time
async def test_the_streamed_board_answers_with_settings_and_voltage() -> None:
    board = LinkBench(flash=FlashContent(lines=13), battery_volts=11.1)
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        settings = await talk.read_settings(WANT)
        assert settings is not None
        assert (settings["lines"], settings["version"]) == (13, "1.7.3")
        volts = await talk.read_battery()
        assert volts is not None
        assert abs(volts - 11.1) < 0.2


@on_virtual_time
async def test_the_polled_board_has_neither_and_is_not_waited_for() -> None:
    board = LinkBench(dialect="polled")
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        start_ns = board.now_ns
        assert await talk.read_settings(WANT) is None
        assert await talk.read_battery() is None
        assert board.now_ns == start_ns


@on_virtual_time
async def test_the_version_among_the_settings_is_no_reset() -> None:
    board = LinkBench()
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        await talk.read_settings(WANT)
        await talk.read_settings(WANT)
        assert talk.heard.resets == 0


@on_virtual_time
async def test_the_banner_of_a_board_that_restarts_is_noticed() -> None:
    board = LinkBench()
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        board.robot.reset(board.now_ns)
        await asyncio.sleep(0.2)
        board.robot.brown_out(board.now_ns)
        await asyncio.sleep(0.2)
        assert talk.heard.resets == 2


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_leaving_stops_the_wheels_whatever_happened(dialect: str) -> None:
    board = LinkBench(dialect=dialect)
    await board.drive()
    port = await board.open()
    with pytest.raises(ZeroDivisionError):
        async with Conversation(port, board.clock):
            # Before anybody knows who is there.
            assert 1 / 0
    await asyncio.sleep(0.5)
    assert max(map(abs, board.rim_speeds)) < 0.03
    assert port.closed


@on_virtual_time
async def test_leaving_after_a_rest_says_nothing_more() -> None:
    board = LinkBench()
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        await talk.rest()
        said = len(board.frames)
    assert len(board.frames) == said


@on_virtual_time
async def test_a_conversation_that_is_cancelled_stops_the_wheels() -> None:
    board = LinkBench()
    await board.drive()
    port = await board.open()

    async def talk_for_ever() -> None:
        async with Conversation(port, board.clock) as talk:
            await talk.identify()
            await asyncio.sleep(60.0)

    task = asyncio.create_task(talk_for_ever())
    await asyncio.sleep(0.2)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert port.closed
    assert port.frames[-2:] == [b"$upload:0,0,0#", b"$pwm:0,0,0,0#"]
    assert max(map(abs, board.rim_speeds)) < 0.03


@on_virtual_time
async def test_a_port_that_goes_away_ends_a_question_at_once() -> None:
    board = LinkBench()
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        asyncio.get_running_loop().call_later(0.05, lambda: board.robot.unplug(board.now_ns))
        start_ns = board.now_ns
        with pytest.raises(PortLost):
            await talk.request(b"$nothing#", lambda _said: False, 5.0)
        assert board.now_ns - start_ns < 100_000_000


@on_virtual_time
async def test_another_dialect_than_the_wanted_one_is_refused() -> None:
    board = LinkBench(dialect="polled")
    async with Conversation(await board.open(), board.clock) as talk:
        with pytest.raises(BoardError, match="speaks the polled dialect"):
            await talk.identify("streamed")


@on_virtual_time
async def test_what_babble_said_is_kept_in_part_and_counted_whole() -> None:
    board = LinkBench()
    port = await board.open()
    board.robot.babble(board.now_ns, 10.0)
    async with Conversation(port, board.clock) as talk:
        with pytest.raises(BoardSilent):
            await talk.identify()
        assert len(talk.heard.start) == KEPT_BYTES
        assert talk.heard.counters.bytes > 5000


@on_virtual_time
async def test_wheels_without_counters_are_neither_standing_nor_turning() -> None:
    board = LinkBench()
    async with Conversation(await board.open(), board.clock) as talk:
        await talk.identify()
        board.robot.mute(board.now_ns, 60.0)
        assert await talk.read_counters() is None
        assert await talk.watch_wheels(0.5) is None
