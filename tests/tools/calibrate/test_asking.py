"""Answers of a person, on a pipe as on a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator

import pytest

from yahboomd.core.errors import Refused
from yahboomd.tools.terminal.asking import Answers, Number


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[bytes], None]]:
    """Types on standard input, and closes it."""
    reading, writing = os.pipe()

    def write(text: bytes) -> None:
        os.write(writing, text)
        os.close(writing)

    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield write


async def test_a_number_is_asked_for_until_a_possible_one_comes(typed, capsys) -> None:
    typed(b"far\n-3\n1,987\n")
    asked = Answers()
    length = await asked.number(
        Number("length", "How far?", "m", lambda value: value > 0, "Metres above 0.")
    )
    assert length == 1.987
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("How far?") == 3
    assert err.count("Metres above 0.") == 2


async def test_an_empty_line_means_what_the_question_says(typed) -> None:
    typed(b"\n\n")
    asked = Answers()
    assert await asked.number(Number("n", "?", "m", bool, "", blank=0.0)) == 0.0
    assert await asked.number(Number("n", "?", "m", bool, "")) is None


async def test_an_input_that_ends_ends_the_questions(typed) -> None:
    typed(b"12")
    asked = Answers()
    assert await asked.number(Number("n", "?", "m", bool, "")) == 12.0
    with pytest.raises(Refused, match="nothing was written"):
        await asked.confirm("done", "?")
