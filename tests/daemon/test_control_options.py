from __future__ import annotations

from collections.abc import Mapping

import pytest

from yahboomd.config import load
from yahboomd.daemon import assembly
from yahboomd.daemon.control_options import ControlOptions
from yahboomd.drive.faults import Action, Fault, FaultKind


def options(overrides: Mapping[str, str]) -> ControlOptions:
    words = [f"{key}={value}" for key, value in overrides.items()]
    return assembly.control_options(load(None, environ={}, overrides=words))


def fault(kind: FaultKind, action: Action = "policy") -> Fault:
    return Fault(kind=kind, motor="left", message="left is wrong.", action=action)


@pytest.mark.parametrize("stall", ["stop", "report"])
@pytest.mark.parametrize("turns", ["stop", "report"])
def test_each_fault_is_answered_as_its_own_option_says(stall: str, turns: str) -> None:
    told = options({"faults.stall": stall, "faults.turns_without_command": turns})
    assert told.cuts(fault("no_counts")) is (stall == "stop")
    assert told.cuts(fault("turns_without_command")) is (turns == "stop")


def test_a_stalled_wheel_stops_the_robot_and_one_that_is_pushed_does_not_unless_told() -> None:
    told = options({})
    assert told.cuts(fault("no_counts"))
    assert not told.cuts(fault("turns_without_command"))


@pytest.mark.parametrize("says", ["stop", "report"])
def test_no_option_keeps_a_runaway_wheel_going_or_stops_one_that_is_only_slow(says: str) -> None:
    told = options({"faults.stall": says, "faults.turns_without_command": says})
    assert told.cuts(fault("runaway_fast", "cut"))
    assert not told.cuts(fault("off_speed", "report"))
