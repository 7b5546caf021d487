"""The board as a daemon describes it, in the form of a board's own answers."""

from __future__ import annotations

from typing import Any

import pytest

from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import is_complete
from yahboomd.tools.probe.probe_client import examination

FACTS: dict[str, Any] = {
    "port": "/dev/board",
    "dialect": "streamed",
    "version": "1.7.3",
    "motor_type": 1,
    "deadzone": 1600,
    "lines": 11,
    "ratio": 30,
    "wheel_diameter_mm": 67.0,
    "p": 0.8,
    "i": 0.06,
    "d": 0.5,
    "volts": 7.4,
}


def test_the_facts_become_settings() -> None:
    found = examination(FACTS)
    assert found is not None
    assert found.settings is not None
    assert is_complete(DIALECTS["streamed"].settings, found.settings)
    assert found.settings["pid"] == (0.8, 0.06, 0.5)
    assert found.volts == 7.4


def test_a_polled_board_has_no_settings() -> None:
    found = examination({"dialect": "polled"})
    assert found is not None
    assert found.settings is None


@pytest.mark.parametrize(
    "facts", [{}, {"dialect": "morse"}, FACTS | {"lines": "many"}, FACTS | {"volts": "much"}]
)
def test_facts_that_make_no_sense_are_none(facts: dict[str, Any]) -> None:
    assert examination(facts) is None
