from __future__ import annotations

import pytest

from yahboomd.tools.screens.rates import NS_PER_S, Counter

MS = 1_000_000


def test_a_counter_that_rises_evenly_has_that_rate() -> None:
    rate = Counter(2 * NS_PER_S)
    for beat in range(100):
        rate.add(2 * beat, beat * 10 * MS)
    assert rate.per_s(99 * 10 * MS) == pytest.approx(200.0)


def test_the_rate_is_that_of_the_latest_seconds_alone() -> None:
    rate = Counter(NS_PER_S)
    for second in range(10):
        rate.add(1000 * second, second * NS_PER_S)
    rate.add(9001, 10 * NS_PER_S)
    rate.add(9002, 11 * NS_PER_S)
    assert rate.per_s(11 * NS_PER_S) == pytest.approx(1.0)


def test_a_counter_that_restarts_is_no_negative_rate() -> None:
    rate = Counter(2 * NS_PER_S)
    rate.add(5000, 0)
    rate.add(0, NS_PER_S)
    assert rate.per_s(NS_PER_S) is None
    rate.add(10, 2 * NS_PER_S)
    assert rate.per_s(2 * NS_PER_S) == pytest.approx(10.0)


def test_only_a_rise_that_was_seen_is_news_and_only_for_a_while() -> None:
    rise = Counter(NS_PER_S)
    assert not rise.rising(0)
    rise.add(5, 0)
    assert not rise.rising(0)
    rise.add(6, NS_PER_S)
    assert rise.rising(NS_PER_S)
    rise.add(6, 3 * NS_PER_S // 2)
    assert rise.rising(3 * NS_PER_S // 2)
    for half in range(4, 8):
        rise.add(6, half * NS_PER_S // 2)
    assert not rise.rising(7 * NS_PER_S // 2)
    rise.add(0, 4 * NS_PER_S)
    assert not rise.rising(4 * NS_PER_S)
