from __future__ import annotations

import pytest

from yahboomd.cli.screens.rates import NS_PER_S, Rate, Rise, Scale

MS = 1_000_000


def test_a_counter_that_rises_evenly_has_that_rate() -> None:
    rate = Rate()
    for beat in range(100):
        rate.total(2 * beat, beat * 10 * MS)
    assert rate.per_s(99 * 10 * MS) == pytest.approx(200.0)


def test_one_look_tells_no_rate() -> None:
    rate = Rate()
    assert rate.per_s(0) is None
    rate.total(7, 0)
    assert rate.per_s(0) is None


def test_the_rate_is_that_of_the_latest_seconds_alone() -> None:
    rate = Rate(window_ns=NS_PER_S)
    for second in range(10):
        rate.total(1000 * second, second * NS_PER_S)
    rate.total(9001, 10 * NS_PER_S)
    rate.total(9002, 11 * NS_PER_S)
    assert rate.per_s(11 * NS_PER_S) == pytest.approx(1.0)


def test_a_counter_that_restarts_is_no_negative_rate() -> None:
    rate = Rate()
    rate.total(5000, 0)
    rate.total(0, NS_PER_S)
    assert rate.per_s(NS_PER_S) is None
    rate.total(10, 2 * NS_PER_S)
    assert rate.per_s(2 * NS_PER_S) == pytest.approx(10.0)


def test_nothing_heard_for_longer_than_the_window_is_a_rate_of_zero() -> None:
    rate = Rate(window_ns=NS_PER_S)
    rate.total(0, 0)
    rate.total(50, NS_PER_S)
    assert rate.per_s(2 * NS_PER_S + 1) == 0.0


def test_a_counter_that_is_gone_has_no_rate() -> None:
    rate = Rate()
    rate.total(0, 0)
    rate.total(50, NS_PER_S)
    rate.total(None, NS_PER_S)
    assert rate.per_s(NS_PER_S) is None


def test_only_a_rise_that_was_seen_is_news_and_only_for_a_while() -> None:
    rise = Rise(5, lately_ns=NS_PER_S)
    assert not rise.rising(0)
    rise.see(5, 0)
    assert not rise.rising(0)
    rise.see(6, NS_PER_S)
    assert rise.rising(NS_PER_S)
    assert rise.rising(2 * NS_PER_S)
    assert not rise.rising(2 * NS_PER_S + 1)


def test_a_pause_is_no_part_of_the_rate_after_it() -> None:
    rate = Rate(window_ns=NS_PER_S)
    for beat in range(10):
        rate.total(beat, beat * 20 * MS)
    resumed_ns = 60 * NS_PER_S
    rate.total(10, resumed_ns)
    assert rate.per_s(resumed_ns) is None
    rate.total(11, resumed_ns + 20 * MS)
    assert rate.per_s(resumed_ns + 20 * MS) == pytest.approx(50.0)


def test_a_scale_holds_what_was_seen_lately_and_forgets_the_rest() -> None:
    scale = Scale(smallest=0.1, lately_ns=NS_PER_S)
    assert scale.full == 0.1
    scale.see(0.3, -1.6, now_ns=0)
    assert scale.full == 1.6
    scale.see(0.3, now_ns=NS_PER_S + 1)
    assert scale.full == 1.6
    scale.see(0.2, now_ns=2 * NS_PER_S + 2)
    assert scale.full == 0.3
    scale.see(now_ns=10 * NS_PER_S)
    scale.see(now_ns=20 * NS_PER_S)
    assert scale.full == 0.1
