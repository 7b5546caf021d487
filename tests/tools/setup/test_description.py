from __future__ import annotations

import pytest

from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.tools.setup.description import Given, ask_motors, ask_robot, choose

STORED = BoardSettings(motor_type=1, deadzone=1600, lines=11, ratio=30, wheel_diameter_mm=67.0)


class Says:
    """Answers one after the other, and keeps the questions."""

    def __init__(self, *answers: str) -> None:
        self.questions: list[str] = []
        self._answers = list(answers)

    async def line(self, question: str) -> str:
        self.questions.append(question)
        return self._answers.pop(0)


ROWS = [("520", "one"), ("310", "two")]


@pytest.mark.parametrize(
    ("answers", "chosen"),
    [(["1"], "520"), (["310"], "310"), (["", "3", "x", "2"], "310"), (["520"], "520")],
)
async def test_one_of_several_is_named_or_numbered_and_asked_for_until_it_is(answers, chosen):
    assert await choose(Says(*answers), "Motors:", ROWS) == chosen


async def test_a_board_is_offered_the_motors_that_it_can_have_and_shows_its_own(capsys):
    await ask_motors(Says("520"), Given(), DIALECTS["streamed"], STORED)
    shown = capsys.readouterr().err
    assert "x3" not in shown
    assert [line for line in shown.splitlines() if "as the board is set up" in line] == [
        "   1  520       gear 1:30, 11 lines, wheels of 67 mm   (as the board is set up)"
    ]
    board, profile = await ask_motors(
        Says("x3-plus"), Given(), DIALECTS["rosmaster"], BoardSettings(car_type=2)
    )
    assert (board, profile) == ({"profile": "x3-plus"}, PROFILES["x3-plus"])
    shown = capsys.readouterr().err
    assert "310" not in shown
    assert "wheels of 68.5 mm (R2 and R2L)" in shown
    assert "x3-plus" in next(line for line in shown.splitlines() if "as the board is" in line)


async def test_other_motors_are_described_by_their_figures_and_keep_the_stored_type(capsys):
    person = Says("custom", "13", "20,4", "80")
    board, profile = await ask_motors(person, Given(), DIALECTS["streamed"], STORED)
    assert board == {
        "profile": "custom",
        "lines": 13,
        "ratio": 20.4,
        "wheel_diameter_mm": 80.0,
        "motor_type": 1,
    }
    assert profile.ticks_per_revolution == pytest.approx(13 * 20.4 * 4)
    assert "(Enter: 11)" in person.questions[1]


async def test_what_is_given_is_not_asked_and_enter_takes_the_motors_own_wheel():
    person = Says("", "abc", "0", "170.5")
    found = await ask_robot(
        person, Given(kinematics="skid_steer"), {"profile": "310"}, PROFILES["310"]
    )
    assert (found.wheel_diameter_mm, found.wheel_separation_mm) == (48.0, 170.5)
    assert found.wheel_base_mm is None
    assert len(person.questions) == 4
    nothing = Says()
    given = Given(
        profile="520",
        kinematics="mecanum",
        wheel_diameter_mm=65.0,
        wheel_separation_mm=169.0,
        wheel_base_mm=160.0,
    )
    await ask_motors(nothing, given, DIALECTS["streamed"], STORED)
    found = await ask_robot(nothing, given, {"profile": "520"}, PROFILES["520"])
    assert found.wheel_base_mm == 160.0
    assert nothing.questions == []


@pytest.mark.parametrize(("drive", "asked"), [("mecanum", True), ("ackermann", True), ("1", False)])
async def test_the_axles_distance_is_asked_for_where_it_counts(drive, asked):
    person = Says(drive, "", "150", "160")
    found = await ask_robot(person, Given(), {"profile": "520"}, PROFILES["520"])
    assert (found.wheel_base_mm == 160.0) == asked
