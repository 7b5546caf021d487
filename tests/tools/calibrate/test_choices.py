"""What a page sends becomes the choices of a calibration, or is refused."""

from __future__ import annotations

from typing import Any

import pytest

from yahboomd.tools.calibrate.choices import CALIBRATIONS, TapeRuns, fields_of, read_choices


def test_what_is_not_chosen_is_the_default() -> None:
    chosen = {"straight": 1.5, "turns": 3, "dry-run": True}
    assert read_choices("tape", chosen) == TapeRuns(straight_m=1.5, turns=3, dry_run=True)


@pytest.mark.parametrize(
    ("verb", "choices"),
    [
        ("undo", {}),
        ("tape --dry-run", {}),
        (["tape"], {}),
        (None, {}),
        ("tape", {"config": "/etc/shadow"}),
        ("tape", {"--config": 1}),
        ("tape", {"source": "cmd_vel/teleop"}),
        ("tape", {"straight_m": 1.0}),
        ("tape", {"straight": "1 --dry-run"}),
        ("tape", {"straight": True}),
        ("tape", {"straight": float("nan")}),
        ("tape", {"straight": 1e9}),
        ("tape", {"straight": -1}),
        ("tape", {"turns": 1.5}),
        ("tape", {"dry-run": "yes"}),
        ("tape", {"dry-run": 1}),
        ("imu", {"speed": 0.2}),
    ],
)
def test_nothing_else_that_a_page_sends_is_a_choice(verb: Any, choices: Any) -> None:
    assert read_choices(verb, choices) is None


@pytest.mark.parametrize("verb", CALIBRATIONS)
def test_every_bound_and_default_of_a_field_may_be_chosen_and_nothing_beyond(verb: str) -> None:
    for name, each in fields_of(CALIBRATIONS[verb]).items():
        assert read_choices(verb, {name: each["default"]}) == CALIBRATIONS[verb]()
        if each["type"] == "boolean":
            continue
        least, most = each["minimum"], each["maximum"]
        step = 1 if each["type"] == "integer" else 0.001
        for bound, beyond in ((least, least - step), (most, most + step)):
            assert read_choices(verb, {name: bound}) is not None
            assert read_choices(verb, {name: beyond}) is None


def test_the_usual_choices_come_first_and_have_words_with_their_unit() -> None:
    fields = fields_of(TapeRuns)
    usual, speeds = ["straight", "turns"], ["speed", "turn-speed", "sideways"]
    assert list(fields) == [*usual, *speeds, "dry-run"]
    assert fields["straight"] == {
        "description": "straight run, m",
        "type": "number",
        "minimum": 0.2,
        "maximum": 20.0,
        "default": 2.0,
    }
    assert (fields["turns"]["type"], fields["dry-run"]["type"]) == ("integer", "boolean")
