"""Three lanes and who goes first."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.link.outbox import FrameLane, Outbox, Question


def request(frame: bytes) -> Question:
    return Question(frame=frame, answered=lambda _: False, timeout_ns=1, done=lambda _: None)


@pytest.fixture
def outbox() -> Outbox:
    return Outbox(resend_ns=100)


def drain(outbox: Outbox, now_ns: int = 0) -> list[bytes]:
    frames = []
    while (outgoing := outbox.take(now_ns, busy=False)) is not None:
        frames.append(outgoing.frame)
    return frames


def test_a_stop_overtakes_everything_and_wipes_the_velocity(outbox: Outbox) -> None:
    outbox.request(request(b"config"))
    outbox.velocity(b"drive")
    outbox.poll(b"read")
    outbox.stop((b"brake", b"cut"))
    assert drain(outbox)[:2] == [b"brake", b"cut"]
    assert b"drive" not in drain(outbox, 1_000)


def test_a_stop_goes_out_while_an_answer_is_awaited(outbox: Outbox) -> None:
    outbox.velocity(b"drive")
    assert outbox.take(0, busy=True) is None
    outbox.stop((b"brake",))
    outgoing = outbox.take(0, busy=True)
    assert outgoing is not None
    assert outgoing.lane is FrameLane.STOP


def test_the_newest_velocity_wins_and_the_replaced_one_is_counted(outbox: Outbox) -> None:
    outbox.velocity(b"old")
    outbox.velocity(b"new")
    assert drain(outbox) == [b"new"]
    assert outbox.replaced == 1


def test_the_velocity_is_said_again_until_it_is_replaced(outbox: Outbox) -> None:
    outbox.velocity(b"drive")
    assert drain(outbox, 0) == [b"drive"]
    assert drain(outbox, 99) == []
    assert drain(outbox, 100) == [b"drive"]
    outbox.quiet()
    assert drain(outbox, 1_000) == []


def test_the_same_velocity_again_is_not_sent_early(outbox: Outbox) -> None:
    outbox.velocity(b"drive")
    drain(outbox, 0)
    outbox.velocity(b"drive")
    assert drain(outbox, 50) == []


def test_a_velocity_that_the_board_lost_is_due_at_once(outbox: Outbox) -> None:
    outbox.velocity(b"drive")
    drain(outbox, 0)
    outbox.velocity_lost()
    assert drain(outbox, 1) == [b"drive"]


def test_requests_keep_their_order(outbox: Outbox) -> None:
    for frame in (b"1", b"2", b"3"):
        outbox.request(request(frame))
    assert drain(outbox) == [b"1", b"2", b"3"]


def test_a_withdrawn_request_is_not_sent(outbox: Outbox) -> None:
    first, second = request(b"1"), request(b"2")
    outbox.request(first)
    outbox.request(second)
    outbox.withdraw(first)
    assert drain(outbox) == [b"2"]


def test_a_second_poll_waits_for_the_first(outbox: Outbox) -> None:
    assert outbox.poll(b"read")
    assert not outbox.poll(b"read")
    assert drain(outbox) == [b"read"]
    assert outbox.poll(b"read")


@given(st.integers(min_value=3, max_value=50))
def test_a_flood_of_velocities_starves_neither_polls_nor_requests(turns: int) -> None:
    outbox = Outbox(resend_ns=100)
    lanes = []
    for turn in range(turns):
        outbox.velocity(b"%d" % turn)
        outbox.poll(b"read")
        outgoing = outbox.take(turn, busy=False)
        assert outgoing is not None
        lanes.append(outgoing.lane)
    assert lanes.count(FrameLane.POLL) >= turns // 2
    assert lanes.count(FrameLane.VELOCITY) >= turns // 2
