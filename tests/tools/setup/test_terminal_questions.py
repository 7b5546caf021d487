from __future__ import annotations

import io

import pytest

from yahboomd.core.errors import Refused
from yahboomd.tools.terminal.terminal_questions import (
    Terminal,
    agrees,
    say,
    say_heading,
    say_points,
)


class Says:
    def __init__(self, *answers: str) -> None:
        self.answers = [*answers]

    async def line(self, question: str) -> str:
        assert question.endswith("[y/N]")
        return self.answers.pop(0)


@pytest.mark.parametrize(
    ("answers", "agreed"),
    [
        (["y"], True),
        (["YES"], True),
        ([""], False),
        (["n"], False),
        (["yep", "y"], True),
        (["yes, nearly", "no"], False),
    ],
)
async def test_only_yes_is_yes_and_what_is_neither_is_asked_again(
    answers: list[str], agreed: bool
) -> None:
    person = Says(*answers)
    assert await agrees(person, "Really?") is agreed
    assert person.answers == []


async def test_an_input_that_is_closed_is_refused(monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.stdin", None)
    with pytest.raises(Refused, match="The input ended"):
        await Terminal().line("Who?")
    assert capsys.readouterr().err.startswith("Who?")


def test_words_for_the_person_are_not_the_result(capsys) -> None:
    say("one")
    say_heading("Two")
    say_points(["three " * 30])
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith("one\n\nTwo\n  - three")
    assert all(len(line) <= 100 for line in shown.err.splitlines())
    assert io.StringIO(shown.err).isatty() is False


@pytest.mark.realtime
async def test_what_was_typed_before_the_question_is_no_answer(terminal) -> None:
    process = terminal(
        code="import asyncio, select\n"
        "from yahboomd.tools.terminal.terminal_questions import Terminal\n"
        "async def ask():\n"
        "    t = Terminal()\n"
        "    await t.line('first?')\n"
        "    print('working', flush=True)\n"
        "    select.select([0], [], [])\n"
        "    print('got', await t.line('second?'))\n"
        "asyncio.run(ask())\n"
    )
    await process.shows("first?")
    process.type("\n")
    await process.shows("working")
    process.type("early\n")
    await process.shows("second?")
    process.type("late\n")
    await process.shows("got late")
