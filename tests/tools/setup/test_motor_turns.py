"""Answers of a person who hesitates, mistypes, or saw it wrong at first."""

from __future__ import annotations

from typing import Any

import pytest
from board_bench import LinkBench
from simulated_person import FOUR, TWO, SimulatedPerson, connected, kinds, set_up, true_wiring

from yahboomd.core.errors import Refused
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.options import FOUR_WHEELS, SMOOTH, TWO_WHEELS
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.setup.description import Given


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
async def test_one_wheel_named_twice_is_asked_again_at_both_plugs() -> None:
    # Each motor turns at the first try.
    bench = LinkBench(drive="skid_steer", wiring=FOUR_WHEELS, **SMOOTH)
    # Front left for M1; and for M2 too.
    person = Hesitating(bench, Which_wheel=["1", "1"])
    found = await found_by(person, bench)
    assert connected(found) == true_wiring(bench)
    tried = [question[12:14] for question in person.questions if question.startswith("\nEnter")]
    assert tried == ["M1", "M2", "M3", "M4", "M1", "M2"]


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
