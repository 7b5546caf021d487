"""Who may write when: one command in flight, spacing, answers, and no needless waiting."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from yahboomd.errors import PortLost
from yahboomd.link.writer import Writer
from yahboomd.protocol.dialect import Battery, CommandLost, Totals

MS = 1_000_000
COUNTS = Totals(ticks=(0, 0, 0, 0))


@pytest.fixture
async def writer(port: Any, clock: Any) -> Any:
    writer = Writer(port, clock, resend_ns=100 * MS, spacing_ns=20 * MS)
    task = asyncio.create_task(writer.run())
    await asyncio.sleep(0)
    yield writer
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def settle() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


async def advance(clock: Any, ms: int) -> None:
    for _ in range(ms):
        clock.advance(1)
        await settle()


async def test_a_frame_that_finds_the_line_free_is_written_at_once(writer: Any, port: Any) -> None:
    writer.velocity(b"$a#")
    assert port.frames == [b"$a#"]


async def test_the_next_frame_keeps_the_distance_of_the_dialect(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.velocity(b"$a#")
    writer.velocity(b"$b#")
    assert port.frames == [b"$a#"]
    await advance(clock, 60)
    (first_ns, first), (second_ns, second) = port.sent
    assert (first, second) == (b"$a#", b"$b#")
    assert second_ns - first_ns >= 20 * MS + 3 * port.byte_ns


async def test_a_velocity_is_repeated_at_the_resend_period(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.velocity(b"$a#")
    await advance(clock, 350)
    assert port.frames == [b"$a#"] * 4


async def test_a_stop_waits_for_the_spacing_and_for_nothing_else(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(writer.request(b"$read_vol#", lambda _: False, 10.0))
    await settle()
    writer.velocity(b"$a#")
    writer.stop((b"$stop#",))
    await advance(clock, 30)
    assert port.frames == [b"$read_vol#", b"$stop#"]
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)


async def test_a_request_returns_when_its_answer_came(writer: Any, port: Any, clock: Any) -> None:
    waiting = asyncio.create_task(
        writer.request(b"$read_vol#", lambda said: isinstance(said, Battery), 1.0)
    )
    await advance(clock, 5)
    writer.heard(COUNTS)
    await settle()
    assert not waiting.done()
    writer.heard(Battery(volts=7.4))
    assert await waiting is True


async def test_after_an_answer_the_line_is_free_without_waiting_for_the_spacing(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(
        writer.request(b"$read_vol#", lambda said: isinstance(said, Battery), 1.0)
    )
    await advance(clock, 5)
    writer.heard(Battery(volts=7.4))
    await waiting
    writer.velocity(b"$a#")
    await advance(clock, 3)
    assert port.frames[-1] == b"$a#"


async def test_an_answer_that_never_comes_is_counted_and_opens_the_line(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(writer.request(b"$read_vol#", lambda _: False, 0.1))
    await settle()
    writer.velocity(b"$a#")
    await advance(clock, 130)
    assert await waiting is False
    assert port.frames == [b"$read_vol#", b"$a#"]
    assert writer.counters["answers_missed"] == 1


async def test_a_lost_command_is_said_again_at_once(writer: Any, port: Any, clock: Any) -> None:
    writer.velocity(b"$a#")
    await advance(clock, 30)
    writer.heard(CommandLost(text="fail,Command not found!"))
    await advance(clock, 2)
    assert port.frames == [b"$a#", b"$a#"]
    assert writer.counters["commands_lost"] == 1


async def test_a_poll_blocks_the_line_until_its_answer(writer: Any, port: Any, clock: Any) -> None:
    writer.set_spacing(0)
    assert writer.poll(b"$read#", 100 * MS)
    writer.velocity(b"$a#")
    await advance(clock, 3)
    assert port.frames == [b"$read#"]
    writer.heard(COUNTS)
    assert port.frames == [b"$read#", b"$a#"]


async def test_a_poll_that_came_early_goes_with_the_answer_to_the_one_before(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.set_spacing(0)
    assert writer.poll(b"$read#", 100 * MS)
    assert writer.poll(b"$read#", 100 * MS)
    assert not writer.poll(b"$read#", 100 * MS)
    await advance(clock, 3)
    assert port.frames == [b"$read#"]
    writer.heard(COUNTS)
    assert port.frames == [b"$read#", b"$read#"]


async def test_a_poll_that_is_never_answered_does_not_block_for_ever(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.set_spacing(0)
    writer.poll(b"$read#", 20 * MS)
    writer.velocity(b"$a#")
    await advance(clock, 25)
    assert port.frames == [b"$read#", b"$a#"]
    assert writer.counters["polls_unanswered"] == 1


async def test_a_full_port_takes_nothing_more_and_is_counted(
    writer: Any, port: Any, clock: Any
) -> None:
    port.pending = 10
    writer.velocity(b"$a#")
    writer.velocity(b"$b#")
    assert port.frames == []
    assert writer.facts()["port_full"] >= 1
    assert writer.facts()["velocities_replaced"] == 1
    port.pending = 0
    await advance(clock, 5)
    assert port.frames == [b"$b#"]


async def test_what_is_told_waits_for_no_answer(writer: Any, port: Any, clock: Any) -> None:
    writer.tell(b"$upload:1,0,0#")
    writer.velocity(b"$a#")
    await advance(clock, 30)
    assert port.frames == [b"$upload:1,0,0#", b"$a#"]
    assert writer.counters["answers_missed"] == 0


async def test_quiet_ends_the_repetition(writer: Any, port: Any, clock: Any) -> None:
    writer.velocity(b"$a#")
    writer.quiet()
    await advance(clock, 300)
    assert port.frames == [b"$a#"]


async def test_a_writer_that_is_closed_says_nothing_that_waited(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.poll(b"$read#", 20 * MS)
    writer.velocity(b"$fast#")
    writer.close()
    writer.heard(COUNTS)
    await advance(clock, 300)
    assert port.frames == [b"$read#"]


async def test_a_port_that_takes_nothing_for_300_ms_is_given_up(port: Any, clock: Any) -> None:
    writer = Writer(port, clock, resend_ns=100 * MS, spacing_ns=20 * MS)
    task = asyncio.create_task(writer.run())
    port.pending = 15
    writer.velocity(b"$a#")
    await advance(clock, 290)
    assert not task.done()
    await advance(clock, 20)
    with pytest.raises(PortLost, match="takes no output"):
        await task


async def test_a_port_that_is_full_for_a_moment_is_not_given_up(
    writer: Any, port: Any, clock: Any
) -> None:
    for _ in range(5):
        port.pending = 15
        writer.velocity(b"$a#")
        await advance(clock, 200)
        port.pending = 0
        await advance(clock, 200)
    assert len(port.frames) >= 5


async def test_a_late_answer_belongs_to_the_question_that_was_asked_first(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.poll(b"$read#", 10 * MS)
    first_ns = writer.poll_heard_ns
    await advance(clock, 40)
    writer.poll(b"$read#", 10 * MS)
    assert writer.poll_heard_ns > first_ns
    # The answer to the first question, and then the one to the second.
    assert writer.answered_poll_ns() == first_ns
    assert writer.answered_poll_ns() == writer.poll_heard_ns
    assert writer.answered_poll_ns() is None


async def test_a_question_whose_answer_was_lost_is_forgotten_after_a_while(
    writer: Any, port: Any, clock: Any
) -> None:
    for _ in range(20):
        writer.poll(b"$read#", 10 * MS)
        await advance(clock, 40)
        lost = clock.ns < 1_000_000_000 + 50 * MS
        asked_ns = None if lost else writer.answered_poll_ns()
    assert asked_ns == writer.poll_heard_ns
