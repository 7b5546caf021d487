from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from yahboomd.cli.screens import ansi

ESCAPES = re.compile(r"\x1b\[[0-9;]*m")


def test_a_line_that_fits_is_painted_in_its_styles() -> None:
    assert ansi.paint([("a", "bold red"), ("b", "")], 10) == "\x1b[1;31ma\x1b[0mb"


def test_a_line_without_colours_holds_no_escape_sequence() -> None:
    assert ansi.paint([("a", "bold red"), ("b", "dim")], 10, colours=False) == "ab"


def test_a_line_that_is_too_long_is_cut_and_says_so() -> None:
    assert ansi.paint([("abc", ""), ("def", "red")], 5, colours=False) == "abcd…"[:3] + "d…"


@given(st.lists(st.tuples(st.text(), st.sampled_from(["", "bold", "bold red"]))), st.integers(0, 9))
def test_no_line_is_longer_than_its_room(parts: list[tuple[str, str]], width: int) -> None:
    assert len(ESCAPES.sub("", ansi.paint(parts, width))) <= width


def test_a_frame_clears_each_line_before_it_writes_it_and_all_below() -> None:
    assert ansi.frame(["one", "two", "three"], 2) == "\x1b[H\x1b[2Kone\r\n\x1b[2Ktwo\x1b[0J"
