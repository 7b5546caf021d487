from __future__ import annotations

from random import Random

import pytest

from yahboomd.simulation.impairments import Impairments
from yahboomd.simulation.options import ImpairmentOptions

DATA = bytes(range(256)) * 40


def line(seed: int = 1, **settings: float) -> Impairments:
    return Impairments(ImpairmentOptions(**settings), Random(seed))


def test_a_perfect_line_changes_nothing_and_waits_for_nothing() -> None:
    perfect = line()
    assert perfect.spoil_all(DATA) == DATA
    assert perfect.latency_ns() == 0


def test_the_configured_share_gets_lost() -> None:
    left = line(loss=0.2).spoil_all(DATA)
    assert len(left) / len(DATA) == pytest.approx(0.8, abs=0.02)


def test_a_corrupted_byte_differs_in_one_bit() -> None:
    spoilt = line(corruption=0.1).spoil_all(DATA)
    flipped = [(a ^ b).bit_count() for a, b in zip(DATA, spoilt, strict=True)]
    assert set(flipped) == {0, 1}
    assert sum(flipped) / len(DATA) == pytest.approx(0.1, abs=0.02)


def test_the_same_seed_brings_the_same_faults() -> None:
    assert line(7, loss=0.3).spoil_all(DATA) == line(7, loss=0.3).spoil_all(DATA)
    assert line(7, loss=0.3).spoil_all(DATA) != line(8, loss=0.3).spoil_all(DATA)


def test_delays_lie_between_the_constant_and_the_jitter() -> None:
    delays = [line(seed, delay_s=0.01, jitter_s=0.005).latency_ns() for seed in range(50)]
    assert min(delays) >= 10_000_000
    assert max(delays) <= 15_000_000
    assert len(set(delays)) > 40


def test_settings_change_one_by_one_and_clear_at_once() -> None:
    changed = line(loss=0.5)
    changed.change(corruption=0.25)
    assert changed.settings == ImpairmentOptions(loss=0.5, corruption=0.25)
    changed.clear()
    assert changed.settings == ImpairmentOptions()


@pytest.mark.parametrize("wrong", [{"loss": 1.1}, {"corruption": -0.1}, {"delay_s": -1.0}])
def test_impossible_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="cannot be"):
        line().change(**wrong)
