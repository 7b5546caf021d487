"""The rhythm of commands: two programs on one key, too few, too many."""

from __future__ import annotations

import pytest

from yahboomd.core.drive.arbitration import AllowedSource
from yahboomd.core.drive.rhythm import Rhythm
from yahboomd.core.model import STANDSTILL, Cause, Twist2d

MS = 1_000_000
S = 1000 * MS
FORWARD, TURN = Twist2d(vx=0.3), Twist2d(wz=1.0)


def rhythm(name: str = "cmd_vel", timeout_s: float = 0.5) -> Rhythm:
    return Rhythm(AllowedSource(name=name, priority=10, timeout_s=timeout_s))


def kinds(found: list[Cause]) -> list[str]:
    return [each.kind for each in found]


def publish(of: Rhythm, *programs: tuple[int, Twist2d, str], until_ns: int = 4 * S) -> list[Cause]:
    """Programs that each send one command with a period and a name of its own."""
    times = [
        (at_ns, twist, name)
        for period_ns, twist, name in programs
        for at_ns in range(0, until_ns, period_ns)
    ]
    for at_ns, twist, name in sorted(times, key=lambda row: row[0]):
        of.note(at_ns, twist, name, 1)
    return of.causes(until_ns, ", from one of a, b", refusing=False)


@pytest.mark.parametrize(
    ("period_ns", "other", "values"),
    [
        (50 * MS, STANDSTILL, "0.30 m/s and 0"),
        (100 * MS, STANDSTILL, "0.30 m/s and 0"),
        (300 * MS, STANDSTILL, "0.30 m/s and 0"),
        (33 * MS, TURN, "0.30 m/s and 1.00 rad/s"),
        (33 * MS, Twist2d(vx=-0.2), "0.30 m/s and -0.20 m/s"),
    ],
)
def test_two_programs_on_one_key_are_named_by_their_values(
    period_ns: int, other: Twist2d, values: str
) -> None:
    found = publish(rhythm(), (101 * MS, FORWARD, ""), (period_ns, other, ""))
    assert kinds(found) == ["two_programs"]
    said = values.split(" and ")
    words = f"Two programs command cmd_vel: {values}, from one of a, b. "
    backward = f"Two programs command cmd_vel: {said[1]} and {said[0]}, from one of a, b. "
    assert found[0].text.startswith((words, backward))


def test_programs_that_name_themselves_are_named() -> None:
    (found,) = publish(rhythm(), (101 * MS, FORWARD, "nav"), (50 * MS, STANDSTILL, "joy"))
    assert found.text.startswith("Two programs command cmd_vel: 0.30 m/s (nav) and 0 (joy). ")
    slow = publish(rhythm(), (S, FORWARD, "nav"), (700 * MS, STANDSTILL, "joy"))
    assert "two_programs" in kinds(slow)
    again = rhythm()
    assert publish(again, (101 * MS, FORWARD, "nav"), (50 * MS, STANDSTILL, "nav")) == []


def test_one_program_is_never_taken_for_two() -> None:
    one = rhythm()
    # A key that is tapped twice a second, a stick that is moved, a controller that swings.
    for n in range(400):
        at_ns = n * 50 * MS
        tapped = FORWARD if n % 10 < 3 else STANDSTILL
        swings = Twist2d(vx=0.3, wz=0.1 * (-1) ** n)
        one.note(at_ns, tapped if n < 130 else swings if n < 260 else Twist2d(vx=n / 1000), "", 1)
        assert "two_programs" not in kinds(one.causes(at_ns, "", refusing=False)), n


def test_one_program_that_takes_over_from_another_is_no_pair() -> None:
    of = rhythm()
    for n in range(60):
        name = "nav" if n % 30 < 15 else "joy"
        of.note(n * 100 * MS, FORWARD if name == "nav" else STANDSTILL, name, 1)
        assert kinds(of.causes(n * 100 * MS, "", refusing=False)) == []


def test_two_programs_of_which_one_ended_are_forgotten() -> None:
    of = rhythm()
    publish(of, (101 * MS, FORWARD, ""), (50 * MS, STANDSTILL, ""))
    assert of.causes(8 * S, "", refusing=False) == []


def test_a_command_every_second_is_named_with_its_rate_and_the_timeout_that_fits() -> None:
    (found,) = publish(rhythm(), (S, FORWARD, ""))
    assert found.kind == "too_seldom"
    assert "1.00 s (1.0 Hz) after its command before, which lasts 0.5 s" in found.text
    assert "Send 10 a second" in found.text
    assert 'command.sources."cmd_vel".timeout_s = 1.1' in found.text


@pytest.mark.parametrize("delay_ms", [500, 660])
def test_a_key_that_repeats_late_is_named_while_it_is_held_and_a_while_after(delay_ms: int) -> None:
    keys = rhythm("cmd_vel/teleop", timeout_s=0.3)
    keys.note(0, FORWARD, "", 1)
    for n in range(60):
        keys.note(delay_ms * MS + n * 33 * MS, FORWARD, "", 1)
    (found,) = keys.causes(3 * S, "", refusing=False)
    timeout_s = 0.6 if delay_ms == 500 else 0.8
    assert f'command.sources."cmd_vel/teleop".timeout_s = {timeout_s}.' in found.text
    assert keys.causes(10 * S, "", refusing=False) == []


def test_zeros_and_new_commands_after_a_silence_are_no_gap() -> None:
    of = rhythm()
    for at_ns, twist in ((0, FORWARD), (S, STANDSTILL), (2 * S, FORWARD), (5 * S, FORWARD)):
        of.note(at_ns, twist, "", 1)
        assert of.causes(at_ns, "", refusing=False) == []


def test_commands_that_are_refused_for_their_number_are_named_with_their_rate() -> None:
    of = rhythm()
    for n in range(500):
        of.note(n * 2 * MS, FORWARD, "", 2)
    (found,) = of.causes(S, "", refusing=True)
    assert found.kind == "too_often"
    assert "cmd_vel is commanded 1000 times a second, and more than 250 look" in found.text
    assert of.causes(S, "", refusing=False) == []
