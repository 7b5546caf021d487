from __future__ import annotations

import pytest

from yahboomd.simulation.rosmaster.rosmaster_flash import short, single, thousandths


@pytest.mark.parametrize(
    ("gain", "shown"), [(0.8, 800), (0.251, 250), (0.25, 250), (0.502, 501), (10.0, 10_000)]
)
def test_a_gain_is_cut_to_thousandths_as_a_float_of_32_bits_has_it(gain: float, shown: int) -> None:
    assert thousandths(gain) == shown


def test_a_float_has_24_bits() -> None:
    assert single(0.1) == 0.10000000149011612
    assert single(0.5) == 0.5


@pytest.mark.parametrize(
    ("value", "kept"), [(1.9, 1), (-1.9, -1), (32_767, 32_767), (32_768, -32_768), (200_000, 3392)]
)
def test_16_bits_wrap(value: float, kept: int) -> None:
    assert short(value) == kept
