"""The size of a wheel that is off by the quotient of two gears is another gear."""

from __future__ import annotations

import pytest

from yahboomd.core.protocol.profiles import PROFILES, alike
from yahboomd.tools.calibrate.estimates.gear import another_gear, fits, fitting

KNOWN = alike(PROFILES["520"])


def test_the_vendors_cars_are_no_candidates_for_the_four_channel_board() -> None:
    assert {each.name for each in KNOWN} == {"520", "520-1:19", "520-1:56", "l520", "310", "tt"}
    assert "x3" in {each.name for each in alike(PROFILES["x1"])}


@pytest.mark.parametrize("true", ["520-1:19", "520-1:56", "l520", "310", "tt"])
@pytest.mark.parametrize("share", [0.97, 1.0, 1.03])
def test_a_size_that_is_a_quotient_of_gears_names_the_profile(true: str, share: float) -> None:
    own, other = PROFILES["520"], PROFILES[true]
    factor = share * own.ticks_per_revolution / other.ticks_per_revolution
    words = another_gear(factor, own, KNOWN)
    # 1:56 with 11 lines and 1:45 with 13 are 5 % apart.
    assert f'board.profile = "{true}"' in words or true == "tt"
    assert f"{factor:.3f} is " in words


def test_1_56_for_1_30_is_named_by_its_figures() -> None:
    words = another_gear(0.536, PROFILES["520"], KNOWN)
    assert words.startswith("0.536 is 30/56: the gear is likely 1:56, not 1:30")


@pytest.mark.parametrize("factor", [0.98, 1.0, 1.04, 0.6, 2.5])
def test_a_size_that_is_no_quotient_of_gears_names_none(factor: float) -> None:
    assert another_gear(factor, PROFILES["520"], KNOWN) == ""


def test_what_a_person_sees_of_an_angle_is_not_exact() -> None:
    own = PROFILES["520"]
    assert fits(1320.0 * 1.1, own)
    assert not fits(1320.0 * 1.2, own)
    assert fitting(1320.0 * 3.0, own, KNOWN) is None
    assert fitting(2400.0, own, KNOWN) == PROFILES["520-1:56"]
