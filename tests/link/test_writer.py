"""Turns in writing: one command in flight, spacing, answers, and no needless waiting."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from yahboomd.core.errors import PortLost
from yahboomd.core.link.writer import Spacing, Writer
from yahboomd.core.protocol.dialect import Battery, CommandLost, Totals

MS = 1_000_000
COUNTS = Totals(ticks=(0, 0, 0, 0))


def spaced(frame_ns: int) -> Spacing:
    return Spacing(frame_ns=frame_ns, question_ns=20 * MS, answer_ns=2 * MS)


@pytest.fixture
def spacing_ns() -> int:
    return 20 * MS


@pytest.fixture
async def writer(port: Any, clock: Any, spacing_ns: int) -> Any:
    writer = Writer(port, clock, resend_ns=100 * MS, spacing=spaced(spacing_ns))
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


async def test_no_velocity_follows_a_stop_of_the_guard_before_that_is_acknowledged(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.velocity(b"$a#")
    writer.stopped = lambda: True
    await advance(clock, 250)
    writer.velocity(b"$b#")
    writer.stop((b"$stop#",))
    await advance(clock, 50)
    assert port.frames == [b"$a#", b"$stop#"]
    writer.velocity(b"$c#")
    assert port.frames == [b"$a#", b"$stop#"]
    assert writer.counters["velocities_withheld"] >= 3
    writer.stopped = lambda: False
    await advance(clock, 110)
    assert port.frames[2:] == [b"$c#"]


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
    writer.receive(COUNTS)
    await settle()
    assert not waiting.done()
    writer.receive(Battery(volts=7.4))
    assert await waiting is True


async def test_after_an_answer_the_line_is_free_without_waiting_for_the_spacing(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(
        writer.request(b"$read_vol#", lambda said: isinstance(said, Battery), 1.0)
    )
    await advance(clock, 5)
    writer.receive(Battery(volts=7.4))
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
    await advance(clock, 90)
    assert not waiting.done()
    again = asyncio.create_task(writer.request(b"$read_flash#", lambda _: False, 0.1))
    await advance(clock, 40)
    assert await waiting is False
    assert port.frames[:3] == [b"$read_vol#", b"$a#", b"$read_flash#"]
    assert writer.counters["answers_missed"] == 1
    again.cancel()
    await asyncio.gather(again, return_exceptions=True)


@pytest.mark.cases(8)
@pytest.mark.parametrize("phase_ms", range(0, 330, 3))
async def test_a_reversal_waits_for_the_mailbox_alone_at_every_phase_of_an_unanswered_question(
    writer: Any, port: Any, clock: Any, phase_ms: int
) -> None:
    writer.velocity(b"$ahead#")
    await advance(clock, 25)
    waiting = asyncio.create_task(writer.request(b"$read_vol#", lambda _: False, 0.3))
    await advance(clock, phase_ms)
    commanded_ns = clock.ns
    writer.velocity(b"$back#")
    await advance(clock, 60)
    back_ns = next(at_ns for at_ns, frame in port.sent if frame == b"$back#")
    # The frame before it, whichever that is, and the distance behind it.
    assert back_ns - commanded_ns <= len(b"$read_vol#") * port.byte_ns + 20 * MS + MS
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)


async def test_a_velocity_does_not_fall_into_the_answer_to_a_question(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(writer.request(b"$read_vol#", lambda _: False, 0.3))
    await settle()
    writer.velocity(b"$a#")
    await advance(clock, 40)
    (asked_ns, _), (velocity_ns, _) = port.sent
    assert velocity_ns - asked_ns >= len(b"$read_vol#") * port.byte_ns + 20 * MS
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)


async def test_a_late_answer_does_not_shorten_the_distance_behind_a_velocity(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(
        writer.request(b"$read_vol#", lambda said: isinstance(said, Battery), 0.3)
    )
    await settle()
    writer.velocity(b"$a#")
    await advance(clock, 22)
    assert port.frames[-1] == b"$a#"
    writer.receive(Battery(volts=7.4))
    assert await waiting is True
    writer.velocity(b"$b#")
    await advance(clock, 40)
    (_, _), (a_ns, _), (b_ns, _) = port.sent[:3]
    assert b_ns - a_ns >= 20 * MS + 3 * port.byte_ns


async def test_an_answer_that_comes_after_its_time_is_counted(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(
        writer.request(b"$read_vol#", lambda said: isinstance(said, Battery), 0.1)
    )
    await advance(clock, 130)
    assert await waiting is False
    writer.receive(Battery(volts=7.4))
    writer.receive(Battery(volts=7.4))
    assert writer.counters["answers_late"] == 1


async def test_a_late_answer_to_one_question_does_not_let_a_velocity_into_the_next(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(
        writer.request(b"$read_vol#", lambda said: isinstance(said, Battery), 0.3)
    )
    await settle()
    # The answer to an earlier one arrives before this one has left.
    writer.receive(Battery(volts=7.4))
    writer.velocity(b"$a#")
    await advance(clock, 30)
    assert await waiting is True
    (asked_ns, _), (velocity_ns, _) = port.sent
    assert velocity_ns - asked_ns >= len(b"$read_vol#") * port.byte_ns


async def test_what_expects_no_answer_passes_an_unanswered_question(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(writer.request(b"$read_vol#", lambda _: False, 0.3))
    await settle()
    writer.queue(b"$upload:1,0,0#")
    await advance(clock, 25)
    assert port.frames == [b"$read_vol#", b"$upload:1,0,0#"]
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)


async def test_a_velocity_that_is_lost_beside_a_question_is_said_again(
    writer: Any, port: Any, clock: Any
) -> None:
    waiting = asyncio.create_task(writer.request(b"$read_vol#", lambda _: False, 0.3))
    await settle()
    writer.velocity(b"$a#")
    await advance(clock, 30)
    writer.receive(CommandLost(text="fail,Command not found!"))
    await advance(clock, 20)
    assert port.frames == [b"$read_vol#", b"$a#", b"$a#"]
    assert writer.counters["commands_lost"] == 1
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)


@pytest.mark.parametrize("spacing_ns", [0])
async def test_a_poll_blocks_the_line_until_its_answer(writer: Any, port: Any, clock: Any) -> None:
    assert writer.poll(b"$read#", 100 * MS)
    writer.velocity(b"$a#")
    await advance(clock, 3)
    assert port.frames == [b"$read#"]
    writer.receive(COUNTS)
    assert port.frames == [b"$read#", b"$a#"]


@pytest.mark.cases(6)
@pytest.mark.parametrize("spacing_ns", [0])
@pytest.mark.parametrize("phase_ms", range(0, 120, 3))
async def test_a_velocity_waits_20_ms_at_most_for_the_answer_to_a_slow_poll(
    writer: Any, port: Any, clock: Any, phase_ms: int
) -> None:
    writer.poll(b"$read#", 100 * MS)
    await advance(clock, phase_ms)
    commanded_ns = clock.ns
    writer.velocity(b"$a#")
    await advance(clock, 40)
    assert port.frames[1] == b"$a#"
    assert port.sent[1][0] - commanded_ns <= len(b"$read#") * port.byte_ns + 20 * MS + MS


@pytest.mark.parametrize("spacing_ns", [0])
async def test_a_poll_that_came_early_goes_with_the_answer_to_the_one_before(
    writer: Any, port: Any, clock: Any
) -> None:
    assert writer.poll(b"$read#", 100 * MS)
    assert writer.poll(b"$read#", 100 * MS)
    assert not writer.poll(b"$read#", 100 * MS)
    await advance(clock, 3)
    assert port.frames == [b"$read#"]
    writer.receive(COUNTS)
    assert port.frames == [b"$read#", b"$read#"]


@pytest.mark.parametrize("spacing_ns", [0])
async def test_a_poll_that_is_never_answered_does_not_block_for_ever(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.poll(b"$read#", 20 * MS)
    writer.velocity(b"$a#")
    await advance(clock, 25)
    assert port.frames == [b"$read#", b"$a#"]
    assert writer.counters["polls_unanswered"] == 1


async def test_a_full_port_takes_nothing_more_and_is_counted(
    writer: Any, port: Any, clock: Any
) -> None:
    port.waiting = 10
    writer.velocity(b"$a#")
    writer.velocity(b"$b#")
    assert port.frames == []
    assert writer.status_values()["port_held"] == 1
    assert writer.status_values()["velocities_replaced"] == 1
    port.waiting = 0
    await advance(clock, 25)
    assert port.frames == [b"$b#"]


async def test_a_frame_without_an_answer_waits_for_none(writer: Any, port: Any, clock: Any) -> None:
    writer.queue(b"$upload:1,0,0#")
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
    writer.closed = True
    writer.receive(COUNTS)
    await advance(clock, 300)
    assert port.frames == [b"$read#"]


async def test_a_port_that_takes_nothing_for_300_ms_is_given_up(port: Any, clock: Any) -> None:
    writer = Writer(port, clock, resend_ns=100 * MS, spacing=spaced(20 * MS))
    task = asyncio.create_task(writer.run())
    port.waiting = 15
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
        port.waiting = 15
        writer.velocity(b"$a#")
        await advance(clock, 200)
        port.waiting = 0
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


async def test_answers_that_were_held_back_for_a_second_find_their_questions(
    writer: Any, port: Any, clock: Any
) -> None:
    asked_ns = []
    for number in range(25):
        if number == 2:
            # The first is answered late, so that another one waits when the silence begins.
            assert writer.answered_poll_ns() == asked_ns.pop(0)
        writer.poll(b"$read#", 10 * MS)
        asked_ns.append(writer.poll_heard_ns)
        await advance(clock, 40)
    assert len(set(asked_ns)) == 24
    assert [writer.answered_poll_ns() for _ in asked_ns] == asked_ns


async def test_a_question_whose_answer_was_lost_is_forgotten_after_a_while(
    writer: Any, port: Any, clock: Any
) -> None:
    for _ in range(20):
        writer.poll(b"$read#", 10 * MS)
        await advance(clock, 40)
        lost = clock.ns < 1_000_000_000 + 50 * MS
        asked_ns = None if lost else writer.answered_poll_ns()
    assert asked_ns == writer.poll_heard_ns


async def test_a_stop_waits_for_what_the_kernel_holds_and_goes_before_what_waited_longer(
    writer: Any, port: Any, clock: Any
) -> None:
    port.waiting = 18
    writer.velocity(b"$a#")
    writer.stop((b"$stop#",))
    await advance(clock, 250)
    assert port.frames == []
    port.waiting = 0
    await advance(clock, 60)
    assert port.frames == [b"$stop#"]


async def test_a_port_that_is_slow_is_reported_once_with_its_rate(port: Any, clock: Any) -> None:
    rates: list[float] = []
    writer = Writer(port, clock, resend_ns=100 * MS, spacing=spaced(20 * MS))
    writer.on_slow = rates.append
    task = asyncio.create_task(writer.run())
    for _ in range(3):
        writer.velocity(b"$spd:300,0,300,0#")
        port.waiting = 17
        await advance(clock, 170)
        port.waiting = 0
        await advance(clock, 50)
    assert len(rates) == 1
    assert 90 < rates[0] < 110
    assert writer.status_values()["port_slow"] >= 2
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_an_answer_to_a_poll_wakes_no_writer_that_has_nothing_to_ask(
    writer: Any, port: Any, clock: Any
) -> None:
    writer.velocity(b"$a#")
    await advance(clock, 50)
    writer.poll(b"$read#", 20 * MS)
    alarm_ns = writer._alarm.deadline_ns
    assert alarm_ns is not None
    assert alarm_ns >= clock.now_ns() + 40 * MS
    # A second poll waits for the answer, or until it is overdue.
    await advance(clock, 10)
    writer.poll(b"$read#", 20 * MS)
    assert writer._alarm.deadline_ns < clock.now_ns() + 15 * MS
    await advance(clock, 15)
    assert port.frames == [b"$a#", b"$read#", b"$read#"]
    assert writer.counters["polls_unanswered"] == 1


async def test_an_answer_that_comes_too_late_is_counted(writer: Any, port: Any, clock: Any) -> None:
    writer.poll(b"$read#", 20 * MS)
    await advance(clock, 30)
    writer.receive(COUNTS)
    assert writer.counters["polls_unanswered"] == 1
    writer.poll(b"$read#", 20 * MS)
    await advance(clock, 30)
    # It came in time, and was read later.
    writer.receive(COUNTS, clock.now_ns() - 25 * MS)
    assert writer.counters["polls_unanswered"] == 1
