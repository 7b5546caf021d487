from __future__ import annotations

import pytest

from yahboomd.protocol.profiles import PROFILES
from yahboomd.protocol.registry import DIALECTS, check_storable


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
    assert set(PROFILES) == {"520", "520-1:19", "520-1:56", "l520", "310", "tt"}
    assert all(profile.stored["motor_type"] != 4 for profile in PROFILES.values())


@pytest.mark.parametrize("name", PROFILES)
def test_every_profile_can_be_stored_and_then_has_no_problem(name):
    check_storable(PROFILES[name].settings)
    assert all(
        dialect.findings(PROFILES[name].settings, PROFILES[name]).unfit == ()
        for dialect in DIALECTS.values()
    )
