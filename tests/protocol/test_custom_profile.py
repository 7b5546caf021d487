from __future__ import annotations

import math

import pytest

from yahboomd.errors import ConfigError
from yahboomd.protocol.custom_profile import custom_profile
from yahboomd.protocol.settings import BoardSettings


def test_a_custom_profile_is_built_from_its_figures():
    profile = custom_profile(lines=16, ratio=27.5, wheel_diameter_mm=80.0, motor_type=2)
    assert profile.name == "custom"
    assert profile.ticks_per_revolution == 1760.0
    assert profile.wheel_radius_m == 0.04
    assert profile.settings == BoardSettings(
        motor_type=2, lines=16, ratio=27.5, wheel_diameter_mm=80.0
    )


@pytest.mark.parametrize(
    ("figures", "said"),
    [
        ({"lines": 0}, "encoder lines 0"),
        ({"ratio": 0.0}, "gear ratio 0.0"),
        ({"ratio": math.nan}, "gear ratio nan"),
        ({"wheel_diameter_mm": 0.0}, "wheel diameter 0.0"),
        ({"wheel_diameter_mm": math.inf}, "wheel diameter inf"),
        ({"motor_type": 5}, "motor type 5"),
        ({"motor_type": 4}, "no encoder"),
        ({"deadzone": 3601}, "dead zone 3601"),
        ({"lines": 0, "ratio": 0.0}, "encoder lines 0 .*, gear ratio 0.0"),
    ],
)
def test_an_impossible_custom_profile_is_refused_by_name(figures, said):
    with pytest.raises(ConfigError, match=said):
        custom_profile(**({"lines": 11, "ratio": 30.0, "wheel_diameter_mm": 67.0} | figures))
