from __future__ import annotations

import os
from collections.abc import Iterator

import pytest
from drawn_screen import lines
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.text import Text

from yahboomd.tools.screens.drawing import Screen, line, panel, sentence

ENTER, LEAVE = "\x1b[?1049h", "\x1b[?1049l"


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, int]]:
    """A stand-in for a terminal, 40 by 10."""
    monkeypatch.setenv("COLUMNS", "40")
    monkeypatch.setenv("LINES", "10")
    monkeypatch.setenv("TERM", "xterm-256color")
    reader, writer = os.pipe()
    os.set_blocking(reader, False)
    yield reader, writer
    for fd in (reader, writer):
        try:
            os.close(fd)
        except OSError:
            continue


def written(fd: int) -> str:
    try:
        return os.read(fd, 1 << 20).decode()
    except BlockingIOError:
        return ""


def test_its_screen_is_gone_on_every_way_out(pipe: tuple[int, int]) -> None:
    reader, writer = pipe

    def fail() -> None:
        with Screen(writer):
            assert ENTER in written(reader)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert written(reader).endswith(f"\x1b[?25h{LEAVE}")


def test_the_first_form_that_is_not_too_high_is_drawn(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    high, low = Text("high\n" * 11), line("low")
    with Screen(writer) as screen:
        assert screen.size == (40, 10)
        screen.draw(low, high)
        assert "low" in written(reader)
        screen.draw(high, low)
        screen.draw(sentence("other"))
        assert "high" not in written(reader)
        screen.draw(high)
        assert written(reader).count("high") == 10


def test_a_terminal_that_is_gone_is_reported_and_fails_nothing(pipe: tuple[int, int]) -> None:
    reader, writer = pipe
    gone: list[bool] = []
    with Screen(writer, lambda: gone.append(True)) as screen:
        os.close(reader)
        assert not gone
        screen.draw("unseen")
        assert gone == [True]


@given(st.text(max_size=70), st.text(max_size=70), st.text(max_size=70), st.integers(8, 60))
def test_no_text_breaks_a_panel(words: str, title: str, note: str, width: int) -> None:
    drawn = lines(panel(line(words), title=title, note=note), width, 3)
    assert {cell_len(each) for each in drawn} == {width}
    assert all(each.isprintable() for each in drawn)
