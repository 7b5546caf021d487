from __future__ import annotations

import pytest

from yahboomd.core.errors import ConfigError
from yahboomd.simulation.options import (
    FOUR_WHEELS,
    ImpairmentOptions,
    SimulationOptions,
    Wiring,
    at_plug,
    check,
)


def test_the_default_robot_is_the_articles_with_two_wheels() -> None:
    options = SimulationOptions()
    check(options)
    assert [(wire.name, wire.position) for wire in options.motors] == [("left", 1), ("right", 3)]
    assert options.ticks_per_revolution == 1320


def test_every_drive_has_a_wiring_that_is_possible() -> None:
    check(SimulationOptions(drive="skid_steer"))
    check(SimulationOptions(drive="mecanum"))


def test_every_mistake_is_named_at_once() -> None:
    options = SimulationOptions(
        wheel_radius_m=0.0,
        ratio=float("nan"),
        wiring=(
            Wiring(name="a", position=1, corner="left", command_sign=0),
            Wiring(name="b", position=1, corner="left"),
        ),
        friction_scales=(1.9,),
        sticks=(0.9,),
        impairments=ImpairmentOptions(loss=1.5, delay_s=-1.0),
    )
    with pytest.raises(ConfigError) as refused:
        check(options)
    for word in (
        *("wheel_radius_m", "ratio", "share a position", "signs", "each side", "loss"),
        *("sticks", "friction of a motor"),
    ):
        assert word in str(refused.value)


def test_mecanum_needs_all_four_corners() -> None:
    with pytest.raises(ConfigError, match="each corner"):
        check(SimulationOptions(drive="mecanum", wiring=FOUR_WHEELS[:3]))


def test_a_position_that_the_board_has_not_is_refused() -> None:
    wiring = (
        Wiring(name="left", position=0, corner="left"),
        Wiring(name="right", position=5, corner="right"),
    )
    with pytest.raises(ConfigError, match="positions go from 1 to 4"):
        check(SimulationOptions(wiring=wiring))


def test_a_negative_plug_is_a_motor_that_is_mounted_the_other_way_round() -> None:
    assert at_plug(FOUR_WHEELS[0], 3) == Wiring(name="front_left", position=3, corner="front_left")
    other = at_plug(FOUR_WHEELS[0], -2)
    assert (other.position, other.command_sign, other.encoder_sign) == (2, -1, -1)
