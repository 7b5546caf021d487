"""The size of a wheel that is off by the quotient of two gears is another gear."""

from __future__ import annotations

import re
from itertools import product

import pytest

from yahboomd.core.protocol.profiles import PROFILES, alike, of_its_board
from yahboomd.tools.calibrate.estimates.gear import another_gear, fits, fitting

ALL = tuple(PROFILES.values())


def named(factor: float, own: str) -> str:
    return another_gear(factor, PROFILES[own], alike(PROFILES[own]), of_its_board(PROFILES[own]))


@pytest.mark.parametrize(
    ("own", "names"),
    [
        ("520", {"520", "520-1:19", "520-1:56", "l520"}),
        ("310", {"310"}),
        ("x3", {"x3"}),
        ("sunrise", {"sunrise"}),
    ],
)
def test_alike_are_the_motors_whose_stored_type_is_the_same(own: str, names: set[str]) -> None:
    assert {each.name for each in alike(PROFILES[own])} == names


def test_no_profile_is_named_that_changes_the_type_which_the_board_stores() -> None:
    for own, true, share in product(PROFILES, PROFILES, (0.97, 1.0, 1.03)):
        factor = share * PROFILES[own].ticks_per_revolution / PROFILES[true].ticks_per_revolution
        words = named(factor, own)
        found = re.search(r'board\.profile = "(.*)"', words)
        if found:
            stored, other = PROFILES[own].stored, PROFILES[found[1]].stored
            types = ("car_type", "motor_type")
            assert [stored.get(each) for each in types] == [other.get(each) for each in types]
        elif words:
            assert "Set chassis.ticks_per_revolution = " in words


@pytest.mark.parametrize("true", ["520-1:19", "520-1:56", "l520"])
@pytest.mark.parametrize("share", [0.97, 1.0, 1.03])
def test_a_size_that_is_a_quotient_of_gears_names_the_profile(true: str, share: float) -> None:
    own, other = PROFILES["520"], PROFILES[true]
    factor = share * own.ticks_per_revolution / other.ticks_per_revolution
    words = named(factor, "520")
    assert f'board.profile = "{true}"' in words
    assert f"{factor:.3f} is " in words


def test_1_56_for_1_30_is_named_by_its_figures() -> None:
    words = named(0.536, "520")
    assert words.startswith("0.536 is 30/56: the gear is likely 1:56, not 1:30")


def test_an_x3_whose_wheels_count_1040_keeps_its_profile_and_gets_its_counts() -> None:
    words = named(1320.0 / 1040.0, "x3")
    assert "1.269 is (11 x 30)/(13 x 20): the gear is likely 1:20, not 1:30" in words
    assert "Set chassis.ticks_per_revolution = 1040, and leave board.profile" in words
    # What it does to the speeds.
    assert "commands 0.79 of each speed" in words
    assert "1.27 times as fast" in words
    assert "sunrise" not in words


@pytest.mark.parametrize("factor", [0.98, 1.0, 1.04, 0.48, 2.5])
def test_a_size_that_is_no_quotient_of_gears_names_none(factor: float) -> None:
    assert named(factor, "520") == ""


def test_what_a_person_sees_of_an_angle_is_not_exact() -> None:
    own = PROFILES["520"]
    assert fits(1320.0 * 1.1, own)
    assert not fits(1320.0 * 1.2, own)
    assert fitting(1320.0 * 3.0, own, ALL) is None
    assert fitting(2400.0, own, ALL) == PROFILES["520-1:56"]
