from __future__ import annotations

import random

import pytest

from yahboomd.core.odometry.envelope import (
    BLOCK,
    BLOCKS_MAX,
    SETTLED_ANYHOW,
    SETTLED_BLOCKS,
    Envelope,
)

PERIOD = 10e6
MS = 1e6


def fill(envelope, count, *, ppm=0.0, delay=lambda chance: 0.0, start=0, phase=3.0 * MS):
    chance = random.Random(3)
    for n in range(start, start + count):
        envelope.add(n, phase + n * PERIOD * (1.0 + ppm * 1e-6) + delay(chance))
    return phase + (start + count - 1) * PERIOD * (1.0 + ppm * 1e-6), start + count - 1


def test_a_clock_without_delays_is_found_at_once():
    envelope = Envelope(PERIOD)
    fill(envelope, SETTLED_BLOCKS * BLOCK - 1)
    assert not envelope.settled
    truth, tick = fill(envelope, 1, start=SETTLED_BLOCKS * BLOCK - 1)
    assert envelope.settled
    assert envelope.at(tick) == pytest.approx(truth, abs=1.0)


@pytest.mark.parametrize("ppm", [-500.0, -50.0, 50.0, 500.0])
def test_the_period_is_learned_to_a_few_parts_in_a_million(ppm):
    envelope = Envelope(PERIOD)
    truth, tick = fill(envelope, 2000, ppm=ppm, delay=lambda chance: chance.uniform(0.0, MS))
    assert envelope.drift / PERIOD * 1e6 == pytest.approx(ppm, abs=15.0)
    assert abs(envelope.at(tick) - truth) < 0.1 * MS


def test_large_delays_are_seen_through():
    envelope = Envelope(PERIOD)

    def delay(chance):
        return chance.uniform(0.0, 16.0) * MS + chance.uniform(0.0, 2.5) * MS

    truth, tick = fill(envelope, 3000, ppm=80.0, delay=delay)
    assert envelope.settled
    assert abs(envelope.at(tick) - truth) < 1.0 * MS


def test_a_point_below_the_line_moves_it_at_once():
    envelope = Envelope(PERIOD)
    fill(envelope, 5)
    envelope.add(5, 5 * PERIOD + 1.0 * MS)
    assert envelope.at(5) == pytest.approx(5 * PERIOD + 1.0 * MS)


def test_it_settles_anyhow_when_delays_never_agree():
    envelope = Envelope(PERIOD)
    chance = random.Random(4)
    for n in range(SETTLED_ANYHOW * BLOCK):
        # Every block is lowest at a place of its own.
        envelope.add(n, n * PERIOD + (n // BLOCK % 3) * 5.0 * MS + chance.random() * MS)
    assert envelope.settled


def test_forgetting_keeps_the_period_only():
    envelope = Envelope(PERIOD)
    fill(envelope, 2000, ppm=200.0)
    drift = envelope.drift
    envelope.reset()
    assert not envelope.settled
    assert envelope.drift == drift
    envelope.add(0, 77.0 * MS)
    assert envelope.at(0) == pytest.approx(77.0 * MS)


def test_points_that_were_numbered_otherwise_before_it_settled_are_dropped():
    envelope = Envelope(PERIOD)
    fill(envelope, 10, phase=-7.0 * MS)
    truth, tick = fill(envelope, (SETTLED_BLOCKS + 1) * BLOCK, start=10)
    assert envelope.settled
    assert envelope.at(tick) == pytest.approx(truth, abs=1.0)


def test_a_crystal_that_warms_up_is_followed_within_a_minute():
    """However long it ran at another rate before."""
    envelope, ticks = Envelope(PERIOD), BLOCKS_MAX * BLOCK
    warm_from = 2 * ticks
    fill(envelope, warm_from, ppm=100.0)
    phase = 3.0 * MS + warm_from * PERIOD * 100e-6
    for n in range(warm_from, warm_from + ticks):
        envelope.add(n, phase + n * PERIOD + (n - warm_from) * PERIOD * -100e-6)
    assert BLOCKS_MAX * BLOCK * PERIOD * 1e-9 < 60.0
    assert envelope.drift / PERIOD * 1e6 == pytest.approx(-100.0, abs=1.0)
