from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.backlog import MOST, BacklogGate, Verdict

MS = 1_000_000
S = 1000 * MS
START_NS = 3600 * S


def arrive(
    gate: BacklogGate,
    now_ns: int,
    *,
    arrivals: int = 1,
    proven: bool = False,
    copy: bool = False,
    alike: bool = False,
) -> Verdict:
    return gate.arrive(START_NS + now_ns, arrivals=arrivals, proven=proven, copy=copy, alike=alike)


def test_a_single_command_after_a_silence_passes_at_once() -> None:
    gate = BacklogGate(500 * MS)
    assert arrive(gate, 0) == "pass"
    assert arrive(gate, 10 * S) == "pass"


def test_the_sixth_within_20_ms_revokes_and_the_rest_is_refused() -> None:
    gate = BacklogGate(500 * MS)
    verdicts = [arrive(gate, n * 20_000) for n in range(200)]
    assert verdicts == ["pass"] * MOST + ["revoke"] + ["refuse"] * 194


@pytest.mark.parametrize(("last_ns", "verdict"), [(20 * MS, "revoke"), (20 * MS + 1, "pass")])
def test_six_in_20_ms_are_a_backlog(last_ns: int, verdict: str) -> None:
    gate = BacklogGate(500 * MS)
    assert {arrive(gate, n * 4 * MS) for n in range(MOST)} == {"pass"}
    assert arrive(gate, last_ns) == verdict


def test_a_backlog_handed_over_in_one_piece_never_passes() -> None:
    gate = BacklogGate(500 * MS)
    assert arrive(gate, 0, arrivals=200) == "revoke"


def test_commands_pass_again_once_the_backlog_has_ended() -> None:
    gate = BacklogGate(500 * MS)
    for n in range(200):
        arrive(gate, n * 20_000)
    assert [arrive(gate, n * 20 * MS) for n in range(2, 12)] == ["pass"] * 10


def test_a_backlog_in_two_pieces_is_refused_twice() -> None:
    gate = BacklogGate(500 * MS)
    first = [arrive(gate, n * 1000) for n in range(20)]
    second = [arrive(gate, 100 * MS + n * 1000) for n in range(20)]
    assert first.count("revoke") == second.count("revoke") == 1
    assert first[-1] == second[-1] == "refuse"


@pytest.mark.parametrize(("times", "rate_hz"), [(7, 20), (12, 20), (7, 10), (20, 10)])
def test_commands_that_come_several_times_each_drive_after_a_moment(
    times: int, rate_hz: int
) -> None:
    gate = BacklogGate(500 * MS)
    verdicts = {
        n: [arrive(gate, n * S // rate_hz + copy * 100_000) for copy in range(times)]
        for n in range(3 * rate_hz)
    }
    assert "revoke" in verdicts[0]
    assert all(set(verdicts[n]) == {"pass"} for n in verdicts if n >= 2 * rate_hz)


def test_a_flood_is_refused_for_as_long_as_it_lasts() -> None:
    gate = BacklogGate(500 * MS)
    verdicts = [arrive(gate, n * MS) for n in range(10_000)]
    assert set(verdicts[MOST + 1 :]) == {"refuse"}


def test_a_flood_of_one_command_is_refused_for_as_long_as_it_lasts() -> None:
    gate = BacklogGate(500 * MS)
    verdicts = [arrive(gate, n * MS, alike=n > 0) for n in range(10_000)]
    assert set(verdicts[MOST + 1 :]) == {"refuse"}


@pytest.mark.parametrize("row", [100, 1000])
def test_a_long_backlog_that_says_one_thing_is_refused_while_it_comes_in_pieces(row: int) -> None:
    gate = BacklogGate(500 * MS)
    times = [piece * 100 * MS + n * 10_000 for piece in range(20) for n in range(row)]
    verdicts = [arrive(gate, now_ns, alike=now_ns > 0) for now_ns in times]
    assert verdicts.count("pass") <= 20 * MOST


def test_a_copy_is_judged_as_its_original_was() -> None:
    gate = BacklogGate(500 * MS)
    assert [arrive(gate, 0), arrive(gate, 1, copy=True)] == ["pass", "pass"]
    for n in range(MOST + 1):
        arrive(gate, n)
    assert arrive(gate, MS, copy=True) == "refuse"


def test_a_burst_in_a_running_stream_is_no_backlog() -> None:
    gate = BacklogGate(500 * MS)
    times = itertools.chain(range(0, S, 20 * MS), range(S, S + 10 * MS, MS))
    assert {arrive(gate, now_ns) for now_ns in times} == {"pass"}


def test_commands_proven_fresh_pass_at_any_rate() -> None:
    gate = BacklogGate(500 * MS)
    assert {arrive(gate, n * 50_000, proven=True) for n in range(1000)} == {"pass"}


@given(st.integers(1, 240))
def test_a_sender_below_250_a_second_is_never_taken_for_a_backlog(rate_hz: int) -> None:
    gate = BacklogGate(500 * MS)
    assert {arrive(gate, n * S // rate_hz) for n in range(300)} == {"pass"}


@given(st.lists(st.integers(0, 3 * MS), min_size=6, max_size=100), st.integers(0, S))
def test_whatever_passes_of_a_dense_burst_is_revoked(gaps: list[int], start_ns: int) -> None:
    gate = BacklogGate(500 * MS)
    now_ns = start_ns
    verdicts = []
    for gap_ns in gaps:
        now_ns += gap_ns
        verdicts.append(arrive(gate, now_ns))
    assert verdicts[MOST:] == ["revoke"] + ["refuse"] * (len(gaps) - MOST - 1)
