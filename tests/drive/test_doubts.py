from __future__ import annotations

import pytest
from msgspec import structs

from yahboomd.core.drive.doubts import Doubts
from yahboomd.core.drive.faults import Fault

MS = 1_000_000
RUNAWAY = Fault(kind="runaway_fast", motor="left", message="It runs.", action="cut")
SILENT = Fault(kind="no_counts", motor="left", message="It does not.", action="policy")
ALL_SILENT = structs.replace(SILENT, motor=None)


def test_on_a_clean_line_a_wheel_is_blamed_at_once() -> None:
    assert Doubts().blame(0, RUNAWAY, damages=0)


def test_what_lost_commands_do_not_explain_is_blamed_at_once() -> None:
    assert Doubts().blame(0, structs.replace(SILENT, certain=True), damages=16)


@pytest.mark.parametrize(("fault", "often"), [(RUNAWAY, 5), (SILENT, 8), (ALL_SILENT, 16)])
def test_on_a_noisy_line_a_wheel_is_blamed_for_what_happens_often_in_a_row(
    fault: Fault, often: int
) -> None:
    doubts = Doubts()
    blamed = [doubts.blame(n * 600 * MS, fault, damages=16) for n in range(2 * often)]
    assert blamed == [*[False] * (often - 1), True] * 2


@pytest.mark.parametrize(("damages", "often"), [(0, 1), (1, 2), (3, 4), (4, 5), (9, 5)])
def test_each_damage_of_the_line_excuses_one_trouble_up_to_four(damages: int, often: int) -> None:
    doubts = Doubts()
    blamed = [doubts.blame(n * 600 * MS, RUNAWAY, damages=damages) for n in range(often)]
    assert blamed == [*[False] * (often - 1), True]


@pytest.mark.parametrize(("damages", "blamed"), [(0, [True, True]), (1, [False, False])])
def test_troubles_of_two_wheels_at_the_same_moment_are_one(
    damages: int, blamed: list[bool]
) -> None:
    doubts = Doubts()
    other = structs.replace(RUNAWAY, motor="right")
    assert [doubts.blame(0, each, damages=damages) for each in (RUNAWAY, other)] == blamed
    assert doubts.blame(600 * MS, RUNAWAY, damages=damages)


@pytest.mark.parametrize(("driven_ms", "blamed"), [(1000, False), (500, True)])
def test_a_wheel_that_follows_for_a_second_begins_from_nothing(
    driven_ms: int, blamed: bool
) -> None:
    doubts = Doubts()
    found = []
    for n in range(5):
        for _ in range(driven_ms // 20):
            doubts.drive(20 * MS)
        found.append(doubts.blame(n * MS, RUNAWAY, damages=16))
    assert any(found) is blamed


def test_what_happens_now_and_then_is_not_in_a_row() -> None:
    doubts = Doubts()
    assert not any(doubts.blame(n * 5000 * MS, RUNAWAY, damages=16) for n in range(20))
