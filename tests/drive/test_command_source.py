from __future__ import annotations

import pytest

from yahboomd.core.drive.age import Age, StampPolicy
from yahboomd.core.drive.arbitration import AllowedSource
from yahboomd.core.drive.command_source import CommandSource
from yahboomd.core.model import STANDSTILL, Twist2d

MS = 1_000_000
S = 1000 * MS
FORWARD = Twist2d(vx=0.2)


def source(stamps: StampPolicy = "relative") -> CommandSource:
    return CommandSource(AllowedSource(name="cmd_vel", priority=10, timeout_s=0.5), stamps)


def offer(
    line: CommandSource,
    now_ns: int,
    stamp_ns: int | None = None,
    *,
    twist: Twist2d = FORWARD,
    by_sender: bool = False,
    wall_ns: int | None = None,
    arrivals: int = 1,
) -> object:
    return line.admit(
        twist, now_ns, stamp_ns, by_sender=by_sender, wall_ns=wall_ns, arrivals=arrivals
    )


def test_a_command_is_in_effect_for_its_timeout_and_not_after_it_was_dropped() -> None:
    line = source()
    assert line.in_effect(0) is None
    line.feed(FORWARD, 10 * S)
    assert line.in_effect(10 * S + 499 * MS) == FORWARD
    assert line.in_effect(10 * S + 500 * MS) is None
    line.feed(FORWARD, 20 * S)
    line.drop()
    assert line.in_effect(20 * S) is None
    assert line.deadman.deadline_ns is None


def test_a_source_commands_motion_for_a_second_after_it_did_and_while_its_wish_is_good() -> None:
    line = source()
    assert not line.commands_motion(10 * S)
    line.note_motion(10 * S)
    line.note_motion(9 * S)
    assert line.commands_motion(11 * S - 1)
    assert not line.commands_motion(11 * S)
    line.feed(STANDSTILL, 20 * S)
    assert not line.commands_motion(20 * S)
    line.feed(FORWARD, 20 * S)
    assert line.commands_motion(20 * S + 499 * MS)
    assert not line.commands_motion(20 * S + 500 * MS)


def test_a_sixth_command_in_one_burst_takes_back_and_the_next_is_refused() -> None:
    line = source()
    verdicts = [offer(line, 10 * S + n * MS, twist=Twist2d(vx=0.1 + n)) for n in range(7)]
    assert all(isinstance(each, Age) for each in verdicts[:5])
    assert verdicts[5:] == ["revoke", "refuse"]


def test_copies_of_one_stamped_command_are_no_backlog() -> None:
    line = source()
    verdicts = [offer(line, 10 * S + n * MS, 7 * S, arrivals=1) for n in range(20)]
    assert all(isinstance(each, Age) for each in verdicts)


def test_what_differs_or_stands_for_several_is_no_copy_whatever_its_stamp() -> None:
    differing, several = source(), source()
    verdicts = [
        offer(differing, 10 * S + n * MS, 7 * S, twist=Twist2d(vx=0.1 + n)) for n in range(6)
    ]
    assert verdicts[-1] == "revoke"
    assert isinstance(offer(several, 10 * S, 7 * S), Age)
    assert offer(several, 10 * S + MS, 7 * S, arrivals=6) == "revoke"


@pytest.mark.parametrize("stamp_ns", [None, 0])
def test_without_a_stamp_the_same_again_is_no_copy(stamp_ns: int | None) -> None:
    line = source()
    assert "revoke" in [offer(line, 10 * S + n * MS, stamp_ns) for n in range(8)]


@pytest.mark.parametrize(
    ("stamps", "by_sender", "known"),
    [("relative", True, True), ("relative", False, False), ("absolute", False, True)],
)
def test_the_transports_stamps_say_nothing_of_the_senders_clock_unless_they_decide(
    stamps: StampPolicy, by_sender: bool, known: bool
) -> None:
    line = source(stamps)
    offer(line, 10 * S, 100 * S, by_sender=by_sender, wall_ns=100 * S + 20 * MS)
    assert line.offset.ahead_s(10 * S) == (pytest.approx(-0.02) if known else None)
