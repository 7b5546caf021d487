from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.clock_offset import ClockOffset

MS = 1_000_000
S = 1000 * MS
TIMEOUT_NS = 500 * MS
EPOCH_NS = 1_700_000_000 * S


def hears(offset: ClockOffset, ahead_ns: int, delays_ns: list[int], start_ns: int = 0) -> int:
    """Stamps at 20 Hz of a clock that is ahead, each after its way; returns the last moment."""
    now_ns = start_ns
    for index, delay_ns in enumerate(delays_ns):
        sent_ns = start_ns + index * 50 * MS
        now_ns = max(now_ns, sent_ns + delay_ns)
        offset.saw(now_ns, EPOCH_NS + sent_ns + ahead_ns, EPOCH_NS + now_ns)
    return now_ns


@given(st.integers(-3600 * S, 3600 * S), st.lists(st.integers(0, 3 * S), min_size=1, max_size=20))
def test_the_offset_is_the_clocks_difference_less_the_shortest_way(
    ahead_ns: int, delays_ns: list[int]
) -> None:
    offset = ClockOffset("relative", TIMEOUT_NS)
    now_ns = hears(offset, ahead_ns, [*delays_ns, 0])
    ahead_s = offset.ahead_s(now_ns)
    assert ahead_s is not None
    assert ahead_s <= ahead_ns / 1e9 + 1e-6
    # The last one had no way at all, unless it waited for those before it.
    waited_ns = now_ns - len(delays_ns) * 50 * MS
    assert ahead_s >= (ahead_ns - waited_ns) / 1e9 - 1e-6


def test_without_stamps_nothing_is_known() -> None:
    offset = ClockOffset("relative", TIMEOUT_NS)
    offset.saw(S, None, EPOCH_NS)
    offset.saw(S, 0, EPOCH_NS)
    offset.saw(S, EPOCH_NS, None)
    assert offset.ahead_s(S) is None
    assert offset.warning(S) is None


def test_clocks_that_agree_warn_of_nothing() -> None:
    offset = ClockOffset("absolute", TIMEOUT_NS)
    now_ns = hears(offset, 90 * MS, [3 * MS, 8 * MS])
    assert offset.warning(now_ns) is None
    assert offset.ahead_s(now_ns) == pytest.approx(0.087)
    offset = ClockOffset("absolute", TIMEOUT_NS)
    assert offset.warning(hears(offset, 100 * MS, [0])) is None
    assert offset.warning(hears(offset, 101 * MS, [0])) is not None


@pytest.mark.parametrize(
    ("ahead_ns", "words"),
    [
        (3200 * MS, "3.20 s ahead of"),
        (300 * MS, "0.30 s ahead of"),
        (-3200 * MS, "3.20 s behind"),
        (12 * S - EPOCH_NS, "simulated"),
    ],
)
def test_the_warning_names_the_offset(ahead_ns: int, words: str) -> None:
    offset = ClockOffset("relative", TIMEOUT_NS)
    warning = offset.warning(hears(offset, ahead_ns, [0, 0]))
    assert warning is not None
    assert words in warning
    assert "obeyed" in warning


def test_the_warning_says_what_follows_under_each_policy() -> None:
    said = {}
    for policy in ("relative", "absolute", "ignore"):
        offset = ClockOffset(policy, TIMEOUT_NS)  # type: ignore[arg-type]
        said[policy] = offset.warning(hears(offset, 2 * S, [0]))
    assert "refused" not in str(said["relative"])
    assert "All its commands are refused" in str(said["absolute"])
    assert 'command.stamps to "relative"' in str(said["absolute"])
    assert "however old" in str(said["ignore"])


@pytest.mark.parametrize(("ahead_ns", "seem"), [(300 * MS, "younger"), (-300 * MS, "older")])
def test_less_than_the_timeout_refuses_nothing(ahead_ns: int, seem: str) -> None:
    offset = ClockOffset("absolute", TIMEOUT_NS)
    assert f"seem {seem}" in str(offset.warning(hears(offset, ahead_ns, [0])))


def test_a_clock_that_was_set_right_is_forgiven_in_ten_seconds() -> None:
    offset = ClockOffset("relative", TIMEOUT_NS)
    now_ns = hears(offset, 2 * S, [0])
    now_ns = hears(offset, 0, [0] * 20, now_ns + 50 * MS)
    assert offset.warning(now_ns) is not None
    now_ns = hears(offset, 0, [0] * 20, now_ns + 10 * S)
    assert offset.warning(now_ns) is None
