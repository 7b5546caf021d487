from __future__ import annotations

import pytest

from yahboomd.core.drive.holds import BOARD_RESET, FAULT, WAITING_FOR_BOARD, Hold, Holds, ResetWatch

S = 1_000_000_000


def hold(kind: str, since_ns: int = 0, until_ns: int | None = None) -> Hold:
    return Hold(kind=kind, message="Because.", since_ns=since_ns, until_ns=until_ns)


def test_a_hold_lasts_until_it_is_dropped() -> None:
    holds = Holds()
    holds.add(hold(WAITING_FOR_BOARD))
    assert [h.kind for h in holds.active(100 * S)] == [WAITING_FOR_BOARD]
    assert holds.drop(WAITING_FOR_BOARD)
    assert holds.active(100 * S) == ()
    assert not holds.drop(WAITING_FOR_BOARD)


def test_a_hold_with_an_end_ends_there() -> None:
    holds = Holds()
    holds.add(hold(BOARD_RESET, 0, S))
    assert len(holds.active(S - 1)) == 1
    assert holds.active(S) == ()


def test_holds_of_several_kinds_are_all_in_force_the_oldest_first() -> None:
    holds = Holds()
    holds.add(hold(FAULT, 5))
    holds.add(hold(WAITING_FOR_BOARD, 3))
    assert [h.kind for h in holds.active(10)] == [WAITING_FOR_BOARD, FAULT]


def test_the_same_reason_again_keeps_its_beginning_and_takes_the_new_end() -> None:
    holds = Holds()
    holds.add(hold(BOARD_RESET, 0, S))
    holds.add(hold(BOARD_RESET, S // 2, 2 * S))
    assert holds.active(S) == (hold(BOARD_RESET, 0, 2 * S),)
    # One without an end goes on; one that ended before begins again.
    holds.add(hold(FAULT, S))
    holds.add(hold(FAULT, 3 * S))
    holds.add(hold(BOARD_RESET, 2 * S, 4 * S))
    assert holds.active(3 * S) == (hold(FAULT, S), hold(BOARD_RESET, 2 * S, 4 * S))


def test_after_a_reset_in_motion_the_robot_stands_for_one_second() -> None:
    found = ResetWatch().reset(5 * S, in_motion=True)
    assert found is not None
    assert (found.kind, found.until_ns) == (BOARD_RESET, 6 * S)


def test_a_reset_at_rest_holds_nothing_up() -> None:
    assert ResetWatch().reset(5 * S, in_motion=False) is None


@pytest.mark.parametrize("in_motion", [True, False])
def test_three_resets_in_ten_seconds_are_a_fault_without_an_end(in_motion: bool) -> None:
    watch = ResetWatch()
    watch.reset(100 * S, in_motion=in_motion)
    watch.reset(105 * S, in_motion=in_motion)
    found = watch.reset(110 * S, in_motion=in_motion)
    assert found is not None
    assert (found.kind, found.until_ns) == (FAULT, None)


def test_three_resets_in_more_than_ten_seconds_are_none() -> None:
    watch = ResetWatch()
    found = [watch.reset(at_ns, in_motion=False) for at_ns in (0, 5 * S, 10 * S + 1, 15 * S + 2)]
    assert found == [None] * 4


def test_cleared_resets_count_no_more() -> None:
    watch = ResetWatch()
    watch.reset(0, in_motion=False)
    watch.reset(1, in_motion=False)
    watch.clear()
    assert watch.reset(2, in_motion=False) is None


def test_whether_a_reason_is_in_force_can_be_asked() -> None:
    holds = Holds()
    assert not holds.has(FAULT)
    holds.add(Hold(kind=FAULT, message="m", since_ns=0))
    assert holds.has(FAULT)
    holds.drop(FAULT)
    assert not holds.has(FAULT)
