"""The report on a board names its problems."""

from __future__ import annotations

from typing import Any

import pytest

from yahboomd.core.link.line import ReceivedSample
from yahboomd.core.protocol.dialect import FramerCounters
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.port.probing import Examination, Reopening
from yahboomd.tools.probe.probe_report import Report, report

SOLD = BoardSettings(
    version="1.7.3",
    motor_type=1,
    deadzone=1600,
    lines=11,
    ratio=30,
    wheel_diameter_mm=67.0,
    pid=(0.8, 0.06, 0.5),
)


def board(**facts: Any) -> Examination:
    usual: dict[str, Any] = {
        "dialect": DIALECTS["streamed"],
        "settings": SOLD,
        "volts": 7.4,
        "ticks": (0, 0, 0, 0),
        "standing": True,
        "heard": ReceivedSample(counters=FramerCounters()),
    }
    return Examination(**(usual | facts))


def reported(
    found: Examination,
    reopening: Reopening | None = None,
    *,
    profile: str = "520",
    dialect: str = "auto",
    want: BoardSettings | None = None,
) -> Report:
    motors = PROFILES[profile]
    return report(
        found,
        reopening,
        port="/dev/board",
        device="/dev/ttyUSB0",
        profile=motors,
        want=want or motors.settings,
        wanted_dialect=dialect,
    )


def with_settings(**changes: Any) -> Examination:
    return board(settings=SOLD | changes)


def test_a_board_as_it_is_sold_may_be_driven_and_shows_what_differs() -> None:
    found = reported(board())
    assert found.problems == ()
    assert [(row.name, row.have, row.want) for row in found.differing] == [
        ("dead zone", 1600, 1900)
    ]
    assert (found.firmware, found.volts, found.dialect) == ("1.7.3", 7.4, "streamed")


@pytest.mark.parametrize("name", ["lines", "ratio", "wheel_diameter_mm"])
def test_a_stored_zero_is_a_problem_with_its_remedy(name: str) -> None:
    found = reported(with_settings(**{name: 0}))
    assert len(found.problems) == 1
    assert "run away" in found.problems[0]
    assert "probe --write" in found.problems[0]


def test_a_type_of_other_motors_names_the_profile_that_fits() -> None:
    found = reported(with_settings(motor_type=2, lines=13, ratio=20, wheel_diameter_mm=48.0))
    assert "motor type 2 (310)" in found.problems[0]
    assert any('set board.profile = "310"' in words for words in found.advice)


def test_settings_that_a_streamed_board_does_not_tell_are_a_problem() -> None:
    found = reported(board(settings=None))
    assert found.settings == ()
    assert "without which no wheel may turn. Is the cable bad" in found.problems[0]


def test_a_board_that_answers_without_counters_is_a_problem_with_the_reason() -> None:
    found = reported(board(ticks=None, standing=None, silence="Its alarm is on."))
    assert found.problems == ("The board answers, and sends no counters. Its alarm is on.",)
    assert not any("No counters came" in words for words in found.advice)
    (words,) = reported(board(ticks=None, standing=None)).advice
    assert "No counters came" in words


def test_a_polled_board_stores_nothing_and_that_is_no_problem() -> None:
    found = reported(board(dialect=DIALECTS["polled"], settings=None, volts=None))
    assert found.problems == ()
    assert found.settings == ()


def test_another_dialect_than_the_configured_one_is_a_problem() -> None:
    assert 'serial.dialect = "auto"' in reported(board(), dialect="polled").problems[0]
    assert reported(board(), dialect="streamed").problems == ()


def test_a_wheel_that_turns_by_itself_is_a_problem() -> None:
    assert "A wheel turns" in reported(board(standing=False)).problems[0]


def reopening(survival: Any, after: tuple[int, int, int, int] | None = (0, 0, 0, 0)) -> Reopening:
    return Reopening(survival=survival, before=(0, 0, 0, 0), after=after, banner=False)


def test_a_board_that_opening_resets_comes_with_the_lines_to_try() -> None:
    found = reported(board(), reopening("reset"))
    assert found.reopen == "reset"
    assert "serial.dtr=false" in found.advice[0]
    assert "hangup_on_close" in found.advice[0]


def test_counters_at_zero_ask_for_a_turn_by_hand() -> None:
    assert "by hand" in reported(board(), reopening("unknown")).advice[0]
    assert reported(board(), reopening("unknown", (9000, 0, 0, 0))).advice == ()
    assert reported(board(), reopening("kept", (9000, 0, 0, 0))).advice == ()
