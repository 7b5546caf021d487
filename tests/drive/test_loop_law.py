from __future__ import annotations

import math

import pytest

from yahboomd.core.drive.loop_law import loop_law
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.simulation.speed_loop import LoopSettings, wind_up_s

SOLD = (0.8, 0.06, 0.5)
TUNED = (3.2, 0.24, 2.0)
SUNRISE = (1.5, 0.08, 0.5)


@pytest.mark.parametrize("speed", [0.02, 0.05, 0.12, 0.3])
@pytest.mark.parametrize(("gains", "dead_zone"), [(SOLD, 1600), (SOLD, 1900), (TUNED, 1600)])
def test_full_output_is_that_of_the_firmwares_loop(
    gains: tuple[float, float, float], dead_zone: int, speed: float
) -> None:
    p, i, d = gains
    loop = LoopSettings(mm_s_per_tick=1.0, p=p, i=i, d=d, dead_zone=dead_zone, most_output=2000)
    full_s = wind_up_s(speed * 1e3, loop)
    law = loop_law({"pid": gains, "dead_zone": dead_zone})
    assert law.output(-speed * full_s, -speed) == pytest.approx(1.0, abs=0.03)
    assert law.output(0.5 * speed * full_s, speed) < 0.8


@pytest.mark.parametrize("speed", [0.02, 0.12, 0.3])
def test_a_sunrise_has_less_to_wind_up_than_other_rosmasters(speed: float) -> None:
    p, i, d = SUNRISE
    loop = LoopSettings(mm_s_per_tick=1.0, p=p, i=i, d=d, dead_zone=2000, most_output=1600)
    full_s = wind_up_s(speed * 1e3, loop)
    law = loop_law({"pid": SUNRISE, "car_type": 6})
    assert law.output(speed * full_s, speed) == pytest.approx(1.0, abs=0.03)
    assert not law.dead_zone
    assert loop_law({"pid": SUNRISE, "car_type": 1}).output(speed * full_s, speed) < 0.85


@pytest.mark.parametrize(
    ("settings", "full_m"),
    [
        ({"pid": SOLD}, 1 / 3),
        ({}, 1 / 3),
        # Quick, for safety.
        (None, 1 / 12),
        # As its limit is 2000.
        ({"pid": SOLD, "dead_zone": 0}, 1 / 3),
        ({"pid": SOLD, "dead_zone": 3600}, 1 / 30),
        # The least is taken for a garbled one.
        ({"pid": (0.8, 0.0, 0.5)}, 2.0),
    ],
)
def test_a_board_that_shows_no_gains_is_taken_for_a_quick_one(
    settings: BoardSettings | None, full_m: float
) -> None:
    assert loop_law(settings).output(full_m, 0.0) == pytest.approx(1.0)
    assert math.isclose(loop_law(settings).output(0.0, 0.0), 0.0)


def test_only_a_board_that_stores_a_dead_zone_has_one_to_tune() -> None:
    assert loop_law({"pid": SOLD, "dead_zone": 1600}).dead_zone
    assert not loop_law({"pid": SOLD}).dead_zone
    assert not loop_law(None).dead_zone
