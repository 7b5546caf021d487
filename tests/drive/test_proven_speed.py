from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.drive.proven_speed import ProvenSpeeds

MS = 1_000_000


def test_one_reading_proves_nothing() -> None:
    assert ProvenSpeeds([0.001]).see(0, 5 * MS, (100,)) is None


def test_readings_on_time_prove_nearly_the_speed() -> None:
    speeds = ProvenSpeeds([0.001, 0.001])
    for n in range(10):
        found = speeds.see(n * 20 * MS, n * 20 * MS + 4 * MS, (10 * n, -10 * n))
    assert found == (pytest.approx(0.5, rel=0.1), pytest.approx(-0.5, rel=0.1))


def test_a_request_that_was_heard_late_makes_no_wheel_fast() -> None:
    speeds = ProvenSpeeds([0.001])
    for n in range(10):
        speeds.see(n * 20 * MS, n * 20 * MS + 4 * MS, (10 * n,))
    # Asked at 200 ms, heard at 260 ms: 40 counts more than 20 ms are good for.
    found = speeds.see(200 * MS, 264 * MS, (130,))
    assert found is not None
    assert found[0] <= 0.5


def test_after_a_break_it_begins_anew() -> None:
    speeds = ProvenSpeeds([0.001])
    speeds.see(0, 0, (0,))
    speeds.forget()
    assert speeds.see(20 * MS, 20 * MS, (1000,)) is None


@given(
    st.lists(
        st.tuples(st.integers(1, 100), st.integers(0, 80), st.floats(0.0, 1.0)),
        min_size=2,
        max_size=60,
    )
)
def test_it_is_never_more_than_the_true_speed(
    polls: list[tuple[int, int, float]],
) -> None:
    """A wheel at 1 m/s, asked at any times, sampled at any time before the answer."""
    speeds = ProvenSpeeds([1e-6])
    asked_ms = answered_ms = 0
    for wait_ms, late_ms, share in polls:
        asked_ms = max(asked_ms, answered_ms) + wait_ms
        answered_ms = asked_ms + late_ms
        sampled_ms = asked_ms + share * late_ms
        found = speeds.see(asked_ms * MS, answered_ms * MS, (int(sampled_ms * 1000),))
        if found is not None:
            assert found[0] <= 1.0 + 1e-3
