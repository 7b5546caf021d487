from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.deadman import Deadman
from yahboomd.core.model import NS_PER_S


def test_nothing_has_been_commanded_before_the_first_command() -> None:
    deadman = Deadman(0.5)
    assert deadman.expired(0)
    assert deadman.deadline_ns is None
    assert deadman.age_ns(5) is None


@given(st.integers(0, 10**15), st.integers(0, 2 * NS_PER_S))
def test_a_command_is_good_for_its_timeout_and_no_nanosecond_more(given_ns: int, age: int) -> None:
    deadman = Deadman(0.5)
    deadman.feed(given_ns)
    assert deadman.expired(given_ns + age) == (age >= NS_PER_S // 2)
    assert deadman.deadline_ns == given_ns + NS_PER_S // 2


def test_a_command_delivered_twice_does_not_live_longer() -> None:
    deadman = Deadman(0.5)
    deadman.feed(1000)
    deadman.feed(1000)
    assert deadman.deadline_ns == 1000 + NS_PER_S // 2


def test_a_command_taken_back_is_expired_at_once() -> None:
    deadman = Deadman(0.5)
    deadman.feed(1000)
    deadman.clear()
    assert deadman.expired(1000)
