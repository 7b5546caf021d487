"""Received bytes, their meaning, and the end of a line."""

from __future__ import annotations

import asyncio
import itertools

import pytest
from board_bench import BoardPort, LinkBench

from yahboomd.core.errors import BoardSilent, PortLost
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import KEPT_BYTES, Line
from yahboomd.core.link.port_guard import PortGuard
from yahboomd.core.link.start_notices import Notice
from yahboomd.core.model import Counts, EncoderReading
from yahboomd.core.protocol.dialect import Decoded, Unrecognised
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.tools.port.board_questions import read_counters

COUNTS = b"$MAll:1,2,3,4#\r\n"


class Desk:
    """A port that notes its calls, and a line's results for bytes."""

    name = "/dev/desk"
    byte_ns = 86_805

    def queued(self) -> int:
        return 0

    def __init__(self) -> None:
        self.ticks: list[Counts] = []
        self.said: list[Decoded] = []
        self.line = Line(self, LoopClock())  # type: ignore[arg-type]
        self.received_ns: list[int] = []
        self.line.on_counts = self._count
        self.line.on_said = lambda said, _notice: self.said.append(said)

    def _count(self, reading: EncoderReading) -> None:
        self.ticks.append(reading.ticks)
        self.received_ns.append(reading.received_ns)

    def listen(self, on_data: object, on_lost: object) -> None: ...

    def write(self, data: bytes) -> None: ...

    async def drain(self, timeout_s: float) -> bool:
        return True

    def close(self) -> None: ...

    def take(self, *chunks: bytes) -> None:
        for chunk in chunks:
            self.line._receive(chunk)


@on_virtual_time
async def test_before_the_dialect_is_known_what_comes_is_kept_and_read_when_it_is() -> None:
    desk = Desk()
    async with desk.line.attended():
        desk.take(COUNTS, COUNTS, b"Motor_Version:1.7.3\r\n")
        assert (desk.ticks, desk.said) == ([], [])
        desk.line.understand(DIALECTS["streamed"], spacing_ns=0)
        assert len(desk.line.said) == 3
        assert desk.line.unread == []
        assert (desk.line.heard.resets, desk.line.streaming) == (1, False)
        assert desk.line.counters["board_resets"] == 0
        desk.take(COUNTS)
        assert desk.line.streaming


@on_virtual_time
async def test_counts_alone_tell_the_guard_that_the_board_is_heard(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    desk, guard, heard_ns = Desk(), PortGuard(), []
    monkeypatch.setattr(guard, "heard", heard_ns.append)
    async with desk.line.attended():
        await desk.line.share(guard, DIALECTS["streamed"])
        desk.line.understand(DIALECTS["streamed"], spacing_ns=0)
        desk.take(b"Motor_Version:1.7.3\r\n")
        assert heard_ns == []
        desk.take(COUNTS)
        assert len(heard_ns) == 1


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_a_frame_of_nothing_is_no_count(dialect: str) -> None:
    desk = Desk()
    async with desk.line.attended():
        desk.line.understand(DIALECTS[dialect], spacing_ns=0)
        desk.take(b"$#", b"$#", b"$:#", b"$MAll#", b"$data:#")
        assert [type(each) for each in desk.said] == [Unrecognised] * 5
        assert desk.line.status_values()["unrecognised"] == 5


@on_virtual_time
async def test_what_waited_for_a_reader_that_was_late_came_at_once() -> None:
    desk = Desk()
    async with desk.line.attended():
        desk.line.understand(DIALECTS["streamed"], spacing_ns=0)
        for _ in range(9):
            await asyncio.sleep(0.006)
            desk.take(COUNTS)
        await asyncio.sleep(0.1)
        desk.take(5 * COUNTS)
        gaps_ns = [b - a for a, b in itertools.pairwise(desk.received_ns)]
        assert gaps_ns[-4:] == 4 * [len(COUNTS) * desk.byte_ns]


@on_virtual_time
async def test_what_is_wrong_in_a_handler_ends_the_line_with_it() -> None:
    board = LinkBench()
    line = Line(await board.open(), board.clock)

    async def talk() -> None:
        async with line.attended():
            talk = await Conversation.begin(line)
            line.on_counts = lambda _: 1 / 0  # type: ignore[assignment, return-value]
            await read_counters(talk)
            await asyncio.sleep(60.0)

    with pytest.raises(ZeroDivisionError):
        await talk()
    assert line.report is not None


@on_virtual_time
async def test_the_version_among_the_settings_is_no_reset_and_a_banner_is_one() -> None:
    board = LinkBench()
    line = Line(await board.open(), board.clock)
    notices: list[Notice] = []
    line.on_said = lambda _said, notice: notices.append(notice)
    async with line.attended():
        talk = await Conversation.begin(line)
        await talk.read_settings(PROFILES["520"].settings)
        await talk.read_settings(PROFILES["520"].settings)
        assert line.heard.resets == 0
        board.robot.reset(board.now_ns)
        await asyncio.sleep(0.2)
        board.robot.brown_out(board.now_ns)
        await asyncio.sleep(0.2)
        assert line.heard.resets == 2
        # A version that comes alone, soon after a question for it, may be an answer.
        assert [each for each in notices if each != "none"] == ["start", "unclear"]
        assert line.counters["board_resets"] == 1


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
@on_virtual_time
async def test_leaving_stops_the_wheels_whatever_happened(dialect: str) -> None:
    board = LinkBench(dialect=dialect)
    await board.drive()
    port = await board.open()
    with pytest.raises(ZeroDivisionError):
        async with Line(port, board.clock).attended():
            # Before it is known what board is there.
            assert 1 / 0
    await asyncio.sleep(0.5)
    assert max(map(abs, board.rim_speeds)) < 0.03
    assert port.closed


@on_virtual_time
async def test_leaving_is_not_disturbed_by_further_cancellations() -> None:
    board = LinkBench()
    await board.drive()
    port: BoardPort = await board.open()

    async def talk_for_ever() -> None:
        line = Line(port, board.clock)
        async with line.attended():
            await Conversation.begin(line)
            await asyncio.sleep(60.0)

    task = asyncio.create_task(talk_for_ever())
    await asyncio.sleep(0.2)
    while not task.done():
        task.cancel()
        await asyncio.sleep(0.01)
    assert port.closed
    assert port.frames[-2:] == [b"$upload:0,0,0#", b"$pwm:0,0,0,0#"]
    assert max(map(abs, board.rim_speeds)) < 0.03


@on_virtual_time
async def test_a_port_that_goes_away_ends_what_waits_at_once() -> None:
    board = LinkBench()
    line = Line(await board.open(), board.clock)
    asked_ns = 0

    async def ask() -> None:
        nonlocal asked_ns
        async with line.attended():
            talk = await Conversation.begin(line)
            asyncio.get_running_loop().call_later(0.05, lambda: board.robot.unplug(board.now_ns))
            asked_ns = board.now_ns
            await talk.line.ask(b"$nothing#", lambda _said: False, 5.0)

    with pytest.raises(PortLost, match="went away"):
        await ask()
    assert board.now_ns - asked_ns < 100_000_000


@pytest.mark.parametrize("reopens", [False, True])
@on_virtual_time
async def test_a_port_that_takes_no_output_is_given_another_stop_unless_it_is_opened_again(
    reopens: bool,
) -> None:
    board = LinkBench()
    port = await board.open()
    port.waiting = 13
    line = Line(port, board.clock)

    async def stop() -> None:
        async with line.attended(reopens=reopens):
            await Conversation.begin(line)

    with pytest.raises(PortLost, match="takes no output"):
        await stop()
    assert len(board.frames) == (1 if reopens else 2)
    assert port.closed


@on_virtual_time
async def test_a_stop_that_is_held_up_is_waited_for_whatever_the_board_says_meanwhile() -> None:
    board = LinkBench()
    port = await board.open()
    line = Line(port, board.clock)
    async with line.attended():
        talk = await Conversation.begin(line)
        port.waiting = 13
        resting = asyncio.create_task(talk.rest())
        for _ in range(10):
            await asyncio.sleep(0.1)
            line._receive(b"something\r\n")
        port.waiting = 0
        assert (await resting).flushed


@on_virtual_time
async def test_what_babble_said_is_kept_in_part_and_counted_whole() -> None:
    board = LinkBench()
    port = await board.open()
    board.robot.babble(board.now_ns, 10.0)
    line = Line(port, board.clock)
    async with line.attended():
        with pytest.raises(BoardSilent):
            await Conversation.begin(line)
        assert len(line.heard.start) == KEPT_BYTES
        assert line.heard.counters.bytes > 5000
