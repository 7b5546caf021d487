from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.cli.screens import boxes


@given(
    st.lists(st.text(max_size=40), max_size=5),
    st.integers(8, 60),
    st.text(max_size=70),
    st.text(max_size=70),
    st.one_of(st.none(), st.integers(2, 9)),
)
def test_every_line_of_a_box_is_exactly_as_wide_as_asked(
    lines: list[str], width: int, title: str, note: str, height: int | None
) -> None:
    box = boxes.framed(
        [boxes.line(each) for each in lines], width=width, title=title, note=note, height=height
    )
    assert {each.cell_len for each in box} == {width}
    assert len(box) == (len(lines) + 2 if height is None else height)


def test_a_box_holds_its_lines_between_title_and_note() -> None:
    box = boxes.framed([boxes.line("inside")], width=20, title="head", note="foot")
    assert [each.plain for each in box] == [
        "╭─ head ───────────╮",
        "│ inside           │",
        "╰─────────── foot ─╯",
    ]


def test_a_title_with_brackets_is_no_markup() -> None:
    assert "tcp/[::1]:7448" in boxes.framed([], width=40, title="tcp/[::1]:7448")[0].plain


@pytest.mark.parametrize(
    ("left", "right", "width", "expected"),
    [("ab", "cd", 8, "ab    cd"), ("ab", "cd", 5, "ab cd"), ("abcd", "efgh", 7, "abcd e…")],
)
def test_two_ends_of_a_line_never_overlap(left: str, right: str, width: int, expected: str) -> None:
    assert boxes.ends(boxes.line(left), boxes.line(right), width).plain == expected


def test_boxes_side_by_side_are_as_wide_as_both() -> None:
    one = boxes.framed([boxes.line("a")], width=10, title="")
    other = boxes.framed([boxes.line("b")], width=12, title="")
    assert {each.cell_len for each in boxes.beside(one, other)} == {22}
    assert boxes.stacked(one).plain.count("\n") == 2
