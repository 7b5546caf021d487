from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.drive.windows import SLICES, SlidingCounts, SlidingMinimum

WINDOW_NS = 1000
SLICE_NS = WINDOW_NS // SLICES
EVENTS = st.lists(st.tuples(st.integers(0, 400), st.integers(-1000, 1000)), max_size=60)


@given(EVENTS)
def test_the_minimum_is_that_of_the_window_give_or_take_a_slice(
    events: list[tuple[int, int]],
) -> None:
    window = SlidingMinimum(WINDOW_NS)
    seen: list[tuple[int, int]] = []
    now_ns = 0
    for step_ns, value in events:
        now_ns += step_ns
        window.add(now_ns, value)
        seen.append((now_ns, value))
        smallest = window.smallest(now_ns)
        assert smallest is not None
        assert smallest <= min(v for t, v in seen if now_ns - t <= WINDOW_NS)
        assert smallest >= min(v for t, v in seen if now_ns - t <= WINDOW_NS + SLICE_NS)


def test_an_old_minimum_is_forgotten() -> None:
    window = SlidingMinimum(WINDOW_NS)
    window.add(0, -5)
    assert window.smallest(WINDOW_NS) == -5
    assert window.smallest(2 * WINDOW_NS) is None


def test_a_cleared_window_is_empty() -> None:
    window = SlidingMinimum(WINDOW_NS)
    window.add(0, 1)
    window.clear()
    assert window.smallest(0) is None


def test_a_flood_takes_no_more_memory_than_a_trickle() -> None:
    window, counts = SlidingMinimum(WINDOW_NS), SlidingCounts(WINDOW_NS)
    for now_ns in range(20 * WINDOW_NS):
        window.add(now_ns, now_ns)
        counts.add(now_ns, "x")
    assert len(window._slices) <= SLICES + 2
    assert len(counts._slices) <= SLICES + 2


def test_counts_are_those_of_the_last_window() -> None:
    counts = SlidingCounts(WINDOW_NS)
    counts.add(0, "stale")
    counts.add(900, "stale")
    counts.add(900, "backlog")
    assert counts.counts(1000) == {"stale": 2, "backlog": 1}
    assert counts.counts(1500) == {"stale": 1, "backlog": 1}
    assert counts.counts(5000) == {}
