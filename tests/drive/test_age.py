from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.age import Age, AgeJudge

MS = 1_000_000
S = 1000 * MS
TIMEOUT_NS = 500 * MS
EPOCH_NS = 1_700_000_000 * S


def judged(
    judge: AgeJudge, now_ns: int, stamp_ns: int | None, *, by_sender: bool = True
) -> Age | str:
    return judge.judge(now_ns, stamp_ns, by_sender=by_sender)


def settled(offset_ns: int = EPOCH_NS) -> AgeJudge:
    """A judge that has seen one second of 50 Hz without delay, up to now = 1 s."""
    judge = AgeJudge("relative", TIMEOUT_NS)
    for now_ns in range(0, S + 1, 20 * MS):
        assert isinstance(judged(judge, now_ns, now_ns + offset_ns), Age)
    return judge


@given(st.integers(-EPOCH_NS // 2, EPOCH_NS))
def test_a_constant_offset_of_the_clocks_is_no_age(offset_ns: int) -> None:
    judge = settled(EPOCH_NS + offset_ns)
    now_ns = S + 20 * MS
    assert judged(judge, now_ns, now_ns + EPOCH_NS + offset_ns) == Age(age_ns=0, proven=True)


@given(st.integers(0, 2 * S))
def test_what_was_held_up_for_longer_than_the_timeout_is_stale(delay_ns: int) -> None:
    judge = settled()
    stamp_ns = EPOCH_NS + S + 20 * MS
    verdict = judged(judge, S + 20 * MS + delay_ns, stamp_ns)
    if delay_ns > TIMEOUT_NS:
        assert verdict == "stale"
    else:
        assert verdict == Age(age_ns=delay_ns, proven=True)


def test_a_clock_that_drifts_is_followed() -> None:
    judge = AgeJudge("relative", TIMEOUT_NS)
    for n in range(60 * 50):
        now_ns = n * 20 * MS
        # The sender's clock falls behind by 200 ppm: 12 ms in a minute.
        verdict = judged(judge, now_ns, EPOCH_NS + now_ns - now_ns // 5000)
        assert isinstance(verdict, Age)
        assert verdict.age_ns <= 3 * MS


def test_a_stamp_before_the_newest_is_out_of_order() -> None:
    judge = settled()
    assert judged(judge, S + 5 * MS, EPOCH_NS + S - 5 * MS) == "out_of_order"


def test_the_same_stamp_again_ages_like_the_first() -> None:
    judge = settled()
    assert judged(judge, S + 300 * MS, EPOCH_NS + S) == Age(age_ns=300 * MS, proven=True)
    assert judged(judge, S + 600 * MS, EPOCH_NS + S) == "stale"


def test_a_clock_set_back_is_believed_after_one_timeout() -> None:
    judge = settled()
    verdicts = {
        now_ns: judged(judge, now_ns, EPOCH_NS + now_ns - 3600 * S)
        for now_ns in range(S + 20 * MS, 2 * S, 20 * MS)
    }
    for now_ns, verdict in verdicts.items():
        if now_ns - S <= TIMEOUT_NS:
            assert verdict == "out_of_order"
        else:
            assert isinstance(verdict, Age)
            assert verdict.age_ns == 0


def test_the_first_moments_of_a_history_prove_nothing() -> None:
    judge = AgeJudge("relative", TIMEOUT_NS)
    for n in range(200):
        assert judged(judge, n * 20_000, EPOCH_NS + n * 20 * MS) == Age(age_ns=0, proven=False)


def test_a_routers_stamp_proves_nothing() -> None:
    judge = AgeJudge("relative", TIMEOUT_NS)
    for now_ns in range(0, S, 20 * MS):
        assert judged(judge, now_ns, EPOCH_NS + now_ns, by_sender=False) == Age()


def test_the_stamps_of_sender_and_router_are_different_clocks() -> None:
    judge = settled()
    assert judged(judge, S + 1, 5 * S, by_sender=False) == Age()
    assert judged(judge, S + 2, EPOCH_NS + S + 2) == Age(age_ns=0, proven=True)


@pytest.mark.parametrize("stamp_ns", [None, 0, -5])
def test_no_stamp_is_no_age(stamp_ns: int | None) -> None:
    assert judged(settled(), S, stamp_ns) == Age()


def test_ignored_stamps_are_ignored() -> None:
    judge = AgeJudge("ignore", TIMEOUT_NS)
    assert judged(judge, S, 5) == Age()
    assert judged(judge, S, 1) == Age()


def test_absolute_stamps_are_compared_with_the_shared_clock() -> None:
    judge = AgeJudge("absolute", TIMEOUT_NS)
    wall_ns = EPOCH_NS
    fresh = judge.judge(7, wall_ns - 300 * MS, by_sender=True, wall_ns=wall_ns)
    assert fresh == Age(age_ns=300 * MS, proven=True)
    assert judge.judge(8, wall_ns + 400 * MS, by_sender=True, wall_ns=wall_ns) == Age(proven=True)
    late = judge.judge(9, wall_ns + 400 * MS, by_sender=True, wall_ns=wall_ns + S)
    assert late == "stale"
    ahead = judge.judge(10, wall_ns + 600 * MS, by_sender=True, wall_ns=wall_ns)
    assert ahead == "from_the_future"


def test_a_clock_that_runs_ahead_does_not_silence_one_that_is_right() -> None:
    judge = AgeJudge("absolute", TIMEOUT_NS)
    for now_ns in range(0, 2 * S, 20 * MS):
        wall_ns = EPOCH_NS + now_ns
        right = judge.judge(now_ns, wall_ns, by_sender=True, wall_ns=wall_ns)
        ahead = judge.judge(now_ns + 1, wall_ns + 3600 * S, by_sender=True, wall_ns=wall_ns)
        assert isinstance(right, Age)
        assert ahead == "from_the_future"


@given(st.lists(st.tuples(st.integers(0, S), st.integers(-5, 2**62), st.booleans()), max_size=50))
def test_no_age_is_negative_or_beyond_the_timeout(events: list[tuple[int, int, bool]]) -> None:
    for policy in ("relative", "absolute", "ignore"):
        judge = AgeJudge(policy, TIMEOUT_NS)
        now_ns = 0
        for step_ns, stamp_ns, by_sender in events:
            now_ns += step_ns
            verdict = judge.judge(now_ns, stamp_ns, by_sender=by_sender)
            assert not isinstance(verdict, Age) or 0 <= verdict.age_ns <= TIMEOUT_NS
