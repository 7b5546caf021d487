"""What a client can ask for."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from yahboomd.client.move_messages import MOST_POINTS, Move


def decode(fields: dict[str, Any]) -> Move:
    return msgspec.convert(fields, Move, strict=False)


def test_a_move_needs_a_kind_and_nothing_else() -> None:
    assert decode({"kind": "straight"}).distance_m == 0.0
    with pytest.raises(msgspec.ValidationError):
        decode({"distance_m": 1.0})


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "fly"},
        {"kind": "straight", "distance_m": 1e6},
        {"kind": "turn", "angle_rad": 1e4},
        {"kind": "arc", "radius_m": -1.0},
        {"kind": "straight", "speed_m_s": 0.0},
        {"kind": "follow", "points": [[1.0]]},
        {"kind": "follow", "points": [[1.0, 2.0, 3.0, 4.0]]},
        {"kind": "follow", "points": [[0.0, 0.0]] * (MOST_POINTS + 1)},
        {"kind": "follow", "corner_m": -0.1},
    ],
)
def test_what_is_out_of_all_proportion_is_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(msgspec.ValidationError):
        decode(fields)
