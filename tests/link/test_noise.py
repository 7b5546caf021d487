"""How noisy a line is."""

from __future__ import annotations

from yahboomd.link.noise import LineNoise

S = 1_000_000_000


def test_damaged_chunks_count_for_ten_seconds_up_to_sixteen() -> None:
    noise = LineNoise()
    for number in range(1, 20):
        # However much of a chunk is damaged, it counts once.
        noise.heard(3 * number, number)
        assert noise.damages(number) == min(number, 16)
    noise.heard(3 * 19, 9 * S)
    assert noise.damages(10 * S) == 16
    assert noise.damages(10 * S + 18) == 1
    assert noise.damages(10 * S + 19) == 0
