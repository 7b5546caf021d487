from __future__ import annotations

from typing import get_args

import pytest

from yahboomd.core.drive.age import AgeRefusal
from yahboomd.core.drive.arbitration import (
    AllowedSource,
    CommandRefused,
    Decision,
    Reason,
)
from yahboomd.core.model import STANDSTILL


def test_the_default_decision_is_standstill_without_a_driver() -> None:
    decision = Decision()
    assert (decision.twist, decision.driver, decision.source) == (STANDSTILL, None, None)
    assert decision.why == "no_command"
    assert decision.ramp


def test_whatever_is_wrong_with_a_commands_age_is_a_reason_to_refuse_it() -> None:
    assert set(get_args(AgeRefusal)) <= set(get_args(Reason))


def test_a_command_without_a_timeout_of_its_source_is_good_for_half_a_second() -> None:
    assert AllowedSource(name="cmd_vel", priority=10).timeout_s == 0.5


@pytest.mark.parametrize(
    ("noun", "field"),
    [
        (Decision(), "twist"),
        (CommandRefused(reason="stale", detail="Old."), "reason"),
        (AllowedSource(name="cmd_vel", priority=10), "priority"),
    ],
)
def test_what_was_said_is_not_changed_afterwards(noun: object, field: str) -> None:
    with pytest.raises(AttributeError):
        setattr(noun, field, True)
