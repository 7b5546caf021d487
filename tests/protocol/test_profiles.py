from __future__ import annotations

import math

import pytest

from yahboomd.core.protocol.profiles import PROFILES, alike, of_its_board
from yahboomd.core.protocol.registry import DIALECTS, check_storable


@pytest.mark.parametrize(
    ("name", "motor_type", "deadzone", "ticks", "radius_m"),
    [
        ("520", 1, 1900, 1320.0, 0.0335),
        ("520-1:19", 1, 1900, 836.0, 0.0335),
        ("520-1:56", 1, 1900, 2464.0, 0.0335),
        ("l520", 1, 1900, 1760.0, 0.0335),
        ("310", 2, 1600, 1061.268, 0.024),
        ("tt", 3, 1250, 2340.0, 0.034),
    ],
)
def test_the_profiles_are_the_vendors(name, motor_type, deadzone, ticks, radius_m):
    profile = PROFILES[name]
    assert profile.name == name
    assert profile.stored == {"motor_type": motor_type, "deadzone": deadzone}
    assert profile.ticks_per_revolution == pytest.approx(ticks)
    assert profile.wheel_radius_m == pytest.approx(radius_m)


def test_there_is_no_profile_without_an_encoder():
    motors = {"520", "520-1:19", "520-1:56", "l520", "310", "tt"}
    assert set(PROFILES) == motors | {"x3", "x3-plus", "x1", "r2", "sunrise", "m1"}
    assert all(PROFILES[name].stored["motor_type"] != 4 for name in motors)


@pytest.mark.parametrize(
    ("name", "car_type", "ticks", "turn_mm"),
    [
        ("x3", 1, 1320, 204.203),
        ("x3-plus", 2, 2464, 251.327),
        ("x1", 4, 1320, 215.2),
        ("r2", 5, 836, 215.2),
        ("sunrise", 6, 1040, 204.203),
        ("m1", 10, 2464, 251.327),
    ],
)
def test_the_cars_are_those_of_the_boards_firmware(name, car_type, ticks, turn_mm):
    profile = PROFILES[name]
    assert profile.stored == {"car_type": car_type}
    assert profile.ticks_per_revolution == pytest.approx(ticks)
    assert math.pi * profile.wheel_diameter_mm == pytest.approx(turn_mm, rel=1e-4)


@pytest.mark.parametrize("name", PROFILES)
def test_every_profile_can_be_stored_and_has_no_problem_on_the_board_that_it_belongs_to(name):
    profile = PROFILES[name]
    check_storable(profile.settings)
    for dialect in DIALECTS.values():
        fields = {row.field for row in dialect.settings}
        fits = set(profile.stored) <= fields or not fields
        assert (dialect.findings(profile.settings, profile).unfit == ()) == fits


@pytest.mark.parametrize("own", PROFILES)
def test_another_stored_type_is_never_harmless(own):
    profile = PROFILES[own]
    for other in of_its_board(profile):
        for dialect in DIALECTS.values():
            if dialect.settings and set(profile.stored) <= {row.field for row in dialect.settings}:
                stored = {**profile.settings, **other.stored, "version": "3.6"}
                unfit = dialect.findings(stored, profile).unfit
                assert bool(unfit) == (other not in alike(profile)), (own, other.name)


@pytest.mark.parametrize("name", ["x3", "r2"])
def test_a_car_on_another_board_is_refused_with_what_to_set(name):
    board = {**PROFILES["520"].settings, "version": "1.7.3"}
    (words,) = DIALECTS["streamed"].findings(board, PROFILES[name]).unfit
    assert f"the profile {name} belong to another one. Set board.profile" in words
