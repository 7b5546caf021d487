"""A last look finds wrong answers and wrong gears, on virtual time, before the file is written."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest
from board_bench import LinkBench
from simulated_person import X3, SimulatedPerson, connected, set_up, true_wiring

from yahboomd.core.config import Config
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.options import FOUR_WHEELS, SMOOTH, TWO_WHEELS
from yahboomd.simulation.rosmaster.rosmaster_flash import RosmasterStored
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.setup.description import Given
from yahboomd.tools.setup.last_look import judged
from yahboomd.tools.setup.outcome import SetupOutcome
from yahboomd.tools.setup.robot_file import as_toml


def known(profile: str, kinematics: str = "differential") -> Given:
    return Given(
        profile=profile,
        kinematics=kinematics,
        wheel_diameter_mm=67.0,
        wheel_separation_mm=150.0,
    )


def robot(**options: Any) -> tuple[LinkBench, SimulatedPerson]:
    bench = LinkBench(**{"wiring": TWO_WHEELS, **options})
    person = SimulatedPerson(bench)
    person.looks = True
    person.others["2 stored values differ"] = "n"
    return bench, person


def written(found: SetupOutcome) -> str:
    return as_toml(found.description, found.wiring, gear=found.gear.words)


@pytest.mark.parametrize(
    "drive", ["differential", pytest.param("skid_steer", marks=pytest.mark.nightly)]
)
@on_virtual_time
async def test_a_robot_that_is_as_described_is_seen_to_be(drive: str) -> None:
    bench, person = robot(drive=drive, wiring=FOUR_WHEELS if drive == "skid_steer" else TWO_WHEELS)
    found = await set_up(bench, known("520", drive), person=person)
    assert found.gear.verdict == "fits"
    assert "gear was not checked" not in written(found)
    assert "Is the mark at the bottom now?" in "".join(person.questions)


GEARS = ["520", "520-1:19", "520-1:56", "l520"]


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    ("true", "profile"),
    [*zip(GEARS, GEARS, strict=True), *zip(GEARS, [*GEARS[1:], GEARS[0]], strict=True)],
)
@on_virtual_time
async def test_a_profile_with_another_gear_is_replaced_by_the_one_that_fits(
    true: str, profile: str
) -> None:
    bench, person = robot(ratio=PROFILES[true].ratio)
    found = await set_up(bench, known(profile), person=person)
    assert found.description.board == {"profile": true}
    assert found.gear.verdict == "fits"
    assert connected(found) == true_wiring(bench)
    assert person.turned <= 1.0


@pytest.mark.parametrize("agrees", ["y", pytest.param("n", marks=pytest.mark.nightly)])
@on_virtual_time
async def test_an_x3_whose_wheels_count_1040_stays_an_x3(agrees: str) -> None:
    stored = RosmasterStored(car_type=1)
    bench, person = robot(
        dialect="rosmaster",
        drive="mecanum",
        wiring=FOUR_WHEELS,
        battery_volts=11.5,
        rated_volts=11.5,
        lines=13,
        ratio=20.0,
        wheel_radius_m=0.0325,
        flash=stored,
    )
    person.others["Write 1040 counts"] = agrees
    found = await set_up(bench, X3, person=person)
    assert found.description.board == {"profile": "x3"}
    assert bench.robot.board.flash == stored  # type: ignore[attr-defined]
    assert not any("sunrise" in question for question in person.questions)
    text = written(found)
    config = Config.model_validate(tomllib.loads(text))
    assert config.ticks_per_revolution() == (1040.0 if agrees == "y" else 1320.0)
    assert ("ticks_per_revolution = 1040" in text.replace("\n# ", " ")) is True


@pytest.mark.cases(1)
@pytest.mark.parametrize(
    "lies", [{"Which way did": ["b"]}, {"Which wheel turned?": ["2", "0", "1"]}], ids=str
)
@on_virtual_time
async def test_a_wrong_answer_is_found_before_the_file_is_written(
    lies: dict[str, list[str]],
) -> None:
    # Each motor turns at the first try, so that each lie meets its motor.
    bench, person = robot(**SMOOTH)
    person.lies = {question: [*answers] for question, answers in lies.items()}
    found = await set_up(bench, known("520"), person=person)
    assert connected(found) == true_wiring(bench)
    assert sum("M1 turns" in each for each in person.questions) == 2


@pytest.mark.cases(1)
@pytest.mark.parametrize("last", ["y, and all", "Did every", "\nTurn the mark", "Is the mark"])
@on_virtual_time
async def test_unanswered_the_file_has_a_line_that_the_gear_was_not_checked(last: str) -> None:
    bench, person = robot()
    person.lies = {last: [""]}
    found = await set_up(bench, known("520"), person=person)
    assert found.gear.verdict == "not checked"
    assert "# The gear was not checked." in written(found)


def test_wheels_that_were_not_all_looked_at_leave_the_gear_unchecked() -> None:
    own = PROFILES["520"]
    assert judged([1320.0], own, whole=False).verdict == "not checked"
    assert judged([], own, whole=False).verdict == "not checked"
    assert judged([1320.0, 2464.0], own, whole=True).profile == PROFILES["520-1:56"]
