"""Lines come whole, however the input is cut; its end is noticed."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Callable, Iterator

import pytest

from yahboomd.tools.terminal.input_lines import InputLines, input_ended


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[bytes], None]]:
    """Types on standard input; nothing closes it."""
    reading, writing = os.pipe()

    def write(text: bytes) -> None:
        if text:
            os.write(writing, text)
        else:
            os.close(writing)

    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield write


async def test_lines_come_whole_and_the_last_one_without_its_end(typed) -> None:
    typed(b"one\ntw")
    lines = InputLines()
    assert await lines.line() == "one"
    typed(b"o\nthree")
    assert await lines.line() == "two"
    typed(b"")
    assert await lines.line() == "three"
    assert await lines.line() is None


async def test_a_line_that_is_too_long_ends_the_input(typed) -> None:
    typed(b"a" * 5000)
    lines = InputLines(longest=1000)
    assert await lines.line() is not None
    assert await lines.line() is None


async def test_the_end_of_the_input_is_noticed_after_whatever_came_before(typed) -> None:
    ended = asyncio.create_task(input_ended())
    typed(b"nonsense\n")
    await asyncio.sleep(0)
    assert not ended.done()
    typed(b"")
    await ended


async def test_an_input_that_was_never_there_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    await input_ended()
