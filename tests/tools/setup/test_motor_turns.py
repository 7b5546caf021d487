"""Answers of a person who hesitates, mistypes, or saw it wrong at first."""

from __future__ import annotations

from typing import Any

import pytest
from board_bench import LinkBench
from simulated_person import FOUR, SimulatedPerson, connected, kinds, set_up, true_wiring

from yahboomd.core.errors import BoardSilent, Refused
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.options import FOUR_WHEELS, TWO_WHEELS
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.setup.description import Given

TWO = Given(
    profile="520", kinematics="differential", wheel_diameter_mm=67.0, wheel_separation_mm=150.0
)


class Hesitating(SimulatedPerson):
    """Gives some useless answers first, by the beginning of the question."""

    def __init__(self, bench: LinkBench, **first: list[str]) -> None:
        super().__init__(bench)
        self._first = {words.replace("_", " "): answers for words, answers in first.items()}

    async def line(self, question: str) -> str:
        truth = await super().line(question)
        for words, answers in self._first.items():
            if question.startswith(words) and answers:
                return answers.pop(0)
        return truth


async def found_by(person: SimulatedPerson, bench: LinkBench, given: Given = FOUR) -> Any:
    return await set_up(bench, given, person=person)


@on_virtual_time
async def test_answers_that_are_none_are_asked_for_again(
    capsys: pytest.CaptureFixture[str],
) -> None:
    bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS)
    person = Hesitating(bench, Which_wheel=["", "5", "x"], Which_way=["", "left"])
    found = await found_by(person, bench)
    assert connected(found) == true_wiring(bench)
    assert "The number at the wheel in the picture" in capsys.readouterr().err


@on_virtual_time
async def test_a_person_may_see_it_again() -> None:
    bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS)
    person = Hesitating(bench, Which_wheel=["a"], Which_way=["again"])
    found = await found_by(person, bench)
    assert connected(found) == true_wiring(bench)
    tried = [question for question in person.questions if question.startswith("\nEnter, and M1")]
    assert len(tried) == 3


@on_virtual_time
async def test_one_wheel_named_twice_is_asked_again_at_both_plugs() -> None:
    bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS)
    # Front left for M1; and for M2 too.
    person = Hesitating(bench, Which_wheel=["1", "1"])
    found = await found_by(person, bench)
    assert connected(found) == true_wiring(bench)
    tried = [question[12:14] for question in person.questions if question.startswith("\nEnter")]
    assert tried == ["M1", "M2", "M3", "M4", "M1", "M2"]


@on_virtual_time
async def test_a_wheel_that_was_not_seen_but_counted_is_tried_again() -> None:
    bench = LinkBench(wiring=TWO_WHEELS)
    person = Hesitating(bench, Which_wheel=["0"])
    found = await found_by(person, bench, TWO)
    assert connected(found) == {"left": 1, "right": 3}


@on_virtual_time
async def test_a_person_may_give_up_at_a_fault_and_nothing_is_found() -> None:
    bench = LinkBench(wiring=TWO_WHEELS)
    bench.robot.start(bench.now_ns)
    bench.robot.set_faults("left", FAULTS["encoder-dead"], now_ns=bench.now_ns)
    person = SimulatedPerson(bench)
    question = "(Enter: try again; w: write the file, as if it were repaired; q: end)"
    answers = ["x", "q"]

    async def line(asked: str, line: Any = person.line) -> str:
        return answers.pop(0) if asked == question else await line(asked)

    person.line = line  # type: ignore[method-assign]
    with pytest.raises(Refused, match="run `yahboomd setup` again"):
        await found_by(person, bench, TWO)
    assert answers == []


@on_virtual_time
async def test_a_dead_motor_that_is_repaired_is_tried_where_it_may_be() -> None:
    bench = LinkBench(wiring=TWO_WHEELS)
    bench.robot.start(bench.now_ns)
    bench.robot.set_faults("right", FAULTS["motor-dead"], now_ns=bench.now_ns)
    person = SimulatedPerson(bench)
    person.repair = lambda: bench.robot.set_faults("all", now_ns=bench.now_ns)
    found = await found_by(person, bench, TWO)
    assert connected(found) == {"left": 1, "right": 3}
    assert kinds(found) == set()


@on_virtual_time
async def test_by_hand_a_wheel_that_is_not_counted_is_turned_again_after_the_repair() -> None:
    bench = LinkBench(wiring=TWO_WHEELS, dialect="polled")
    bench.robot.start(bench.now_ns)
    bench.robot.set_faults("right", FAULTS["encoder-dead"], now_ns=bench.now_ns)
    person = SimulatedPerson(bench)
    person.repair = lambda: bench.robot.set_faults("all", now_ns=bench.now_ns)
    found = await found_by(person, bench, TWO)
    assert connected(found) == {"left": 1, "right": 3}
    outputs = {frame for frame in bench.frames if frame.startswith(b"$pwm")}
    assert outputs <= {b"$pwm:0,0,0,0#"}


@on_virtual_time
async def test_counters_that_do_not_come_any_more_end_it() -> None:
    bench = LinkBench(wiring=TWO_WHEELS, dialect="polled")
    person = SimulatedPerson(bench)

    async def line(question: str, line: Any = person.line) -> str:
        if question.startswith("Turn wheel 2"):
            bench.robot.mute(bench.now_ns, 1e6)
            return ""
        return str(await line(question))

    person.line = line  # type: ignore[method-assign]
    with pytest.raises(BoardSilent, match="sends no counters"):
        await found_by(person, bench, TWO)
