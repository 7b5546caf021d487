"""Faults that cut the motors, and boards that do not fit the robot."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from yahboomd.core.config import read
from yahboomd.core.daemon import assembly
from yahboomd.core.daemon.fit import BoardFit, ControlOptions, fit, no_board
from yahboomd.core.drive.faults import Action, Fault, FaultKind
from yahboomd.core.drive.kinematics import differential
from yahboomd.core.link.handshake import Identity
from yahboomd.core.model import Motor
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings


def options(overrides: Mapping[str, str]) -> ControlOptions:
    words = [f"{key}={value}" for key, value in overrides.items()]
    return assembly.control_options(read(None, environ={}, overrides=words).config)


def fault(kind: FaultKind, action: Action = "policy") -> Fault:
    return Fault(kind=kind, motor="left", message="left is wrong.", action=action)


@pytest.mark.parametrize("stall", ["stop", "report"])
@pytest.mark.parametrize("turns", ["stop", "report"])
def test_each_fault_is_answered_as_its_own_option_says(stall: str, turns: str) -> None:
    chosen = options({"faults.stall": stall, "faults.turns_without_command": turns})
    assert chosen.cuts(fault("no_counts")) is (stall == "stop")
    assert chosen.cuts(fault("turns_without_command")) is (turns == "stop")


def test_a_stalled_wheel_stops_the_robot_and_one_that_is_pushed_does_not_by_default() -> None:
    chosen = options({})
    assert chosen.cuts(fault("no_counts"))
    assert not chosen.cuts(fault("turns_without_command"))


@pytest.mark.parametrize("says", ["stop", "report"])
def test_no_option_keeps_a_runaway_wheel_going_or_stops_one_that_is_only_slow(says: str) -> None:
    chosen = options({"faults.stall": says, "faults.turns_without_command": says})
    assert chosen.cuts(fault("runaway_fast", "cut"))
    assert not chosen.cuts(fault("off_speed", "report"))


KINEMATICS = differential(separation_m=0.15)
MOTORS = tuple(
    Motor(name=name, wheel=index, position=position, radius_m=0.0335, ticks_per_revolution=1320.0)
    for index, (name, position) in enumerate((("left", 1), ("right", 3)))
)
SETTINGS = BoardSettings(
    version="1.7.3",
    motor_type=1,
    deadzone=1600,
    lines=11,
    ratio=30,
    wheel_diameter_mm=67.0,
    pid=(0.8, 0.06, 0.5),
)


def held_against(settings: BoardSettings | None, dialect: str = "streamed") -> BoardFit:
    return fit(
        Identity(dialect=DIALECTS[dialect], settings=settings),
        kinematics=KINEMATICS,
        motors=MOTORS,
        profile=PROFILES["520"],
        scale=1.0,
    )


def test_a_board_set_up_as_built_takes_millimetres_per_second() -> None:
    found = held_against(SETTINGS)
    assert found.wrong == ()
    assert found.motion is not None
    assert found.motion.units((0.5, -0.25)) == (500, 0, -250, 0)
    assert found.wheel_limits == pytest.approx((1.0, 1.0))


def test_settings_that_differ_are_made_up_for_in_the_units() -> None:
    smaller = SETTINGS | {"wheel_diameter_mm": 33.5}
    motion = held_against(smaller).motion
    assert motion is not None
    assert motion.units((0.5, 0.5)) == (250, 0, 250, 0)


@pytest.mark.parametrize(
    ("name", "value"), [("lines", 0), ("ratio", 0), ("wheel_diameter_mm", 0.0), ("motor_type", 2)]
)
def test_settings_that_would_run_away_forbid_motion(name: str, value: int) -> None:
    found = held_against(SETTINGS | {name: value})
    assert found.motion is None
    assert found.wheel_limits == (0.0, 0.0)
    assert "yahboomd probe --write" in " ".join(found.wrong)


def test_a_board_without_settings_takes_the_articles_factor() -> None:
    motion = held_against(None, "polled").motion
    assert motion is not None
    assert motion.units((0.5, 0.5)) == (500, 0, 500, 0)


def test_without_a_board_no_wheel_can_turn() -> None:
    assert no_board(KINEMATICS).wheel_limits == (0.0, 0.0)
