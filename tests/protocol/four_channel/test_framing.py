from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.four_channel.framing import (
    MAX_HELD_BYTES,
    RESYNC,
    Frame,
    LineFramer,
    TextLine,
)

FRAGMENTS = (
    b"$",
    b"#",
    b"\r\n",
    b"\n",
    b"\r",
    b"$MAll:1,2,3,4#\r\n",
    b"$data:1,2,3,4#",
    b"$MAll:1,2",
    b"Set mtype:OK!\r\n",
    b"Reset MCU",
    b"Motor_Version:1.7.3\r\n",
    b"x" * 70,
    b"\xff\x00",
)
streams = st.lists(st.sampled_from(FRAGMENTS) | st.binary(max_size=40), max_size=20)


def frame(name: str, args: str, *, trailing: int = 0) -> Frame:
    size = len(f"${name}:{args}#") if args else len(f"${name}#")
    return Frame(name=name, args=args, size=size, trailing=trailing)


def line(text: str, *, ending: int = 2, trailing: int = 0) -> TextLine:
    return TextLine(text=text, size=len(text) + ending, trailing=trailing)


CASES: dict[str, tuple[bytes, list[Frame | TextLine]]] = {
    "nothing": (b"", []),
    "a frame": (b"$data:1,2,3,4#", [frame("data", "1,2,3,4")]),
    "a frame with its line end": (b"$MAll:1,2,3,4#\r\n", [frame("MAll", "1,2,3,4", trailing=2)]),
    "a frame without arguments": (b"$read#", [frame("read", "")]),
    "a frame with two colons": (b"$a:b:c#", [frame("a", "b:c")]),
    "an empty frame": (b"$#", [Frame(name="", args="", size=2, trailing=0)]),
    "two frames in one read": (
        b"$a:1#$b:2#",
        [frame("a", "1", trailing=5), frame("b", "2")],
    ),
    "a line": (b"Set mtype:OK!\r\n", [line("Set mtype:OK!")]),
    "a line that ends in LF alone": (b"Set mtype:OK!\n", [line("Set mtype:OK!", ending=1)]),
    "a line between frames": (
        b"$MAll:1,2,3,4#\r\nSet mtype:OK!\r\n$MAll:1,2,3,5#\r\n",
        [
            frame("MAll", "1,2,3,4", trailing=33),
            line("Set mtype:OK!", trailing=16),
            frame("MAll", "1,2,3,5", trailing=2),
        ],
    ),
    "a banner glued to a reset notice": (
        b"Reset MCUMotor_Version:1.7.3\r\n",
        [line("Reset MCUMotor_Version:1.7.3")],
    ),
    "a banner glued to half a frame": (
        b"$MAll:12,3Motor_Version:1.7.3\r\n",
        [line("$MAll:12,3Motor_Version:1.7.3")],
    ),
    "half a line before a frame": (b"fail,Comm$MAll:1,2,3,4#", [frame("MAll", "1,2,3,4")]),
    "half a frame before a frame": (b"$MAll:1,2$MAll:1,2,3,4#", [frame("MAll", "1,2,3,4")]),
    "the tail of a frame before a frame": (b"3,4#\r\n$data:1,2,3,4#", [frame("data", "1,2,3,4")]),
    "the tail of a frame before a line": (b"3,4#\r\nOK!\r\n", [line("OK!")]),
    "the tail of a frame glued to a line": (b"3,4#OK!\r\n", [line("OK!")]),
    "a frame not ended yet": (b"$MAll:1,2,3,4", []),
    "a line not ended yet": (b"Set mtype:OK!", []),
    "empty lines": (b"\r\n\n\r\r\n", []),
    "bytes that are not ASCII": (
        b"$a:\xff1#\xe9t\xe9\n",
        [
            Frame(name="a", args="\ufffd1", size=6, trailing=4),
            TextLine(text="\ufffdt\ufffd", size=4, trailing=0),
        ],
    ),
    "tabs inside a line": (b"P:0.800\t I:0.060\t \r\n", [line("P:0.800\t I:0.060\t ")]),
    "an overlong frame, then a frame": (
        b"$" + b"1" * MAX_HELD_BYTES + b"#$a:1#",
        [frame("a", "1")],
    ),
    "an overlong frame without end, then a frame": (
        b"$" + b"1" * MAX_HELD_BYTES + b"$a:1#",
        [frame("a", "1")],
    ),
    "an overlong line, then a line": (
        b"x" * (MAX_HELD_BYTES + 1) + b"\r\nOK!\r\n",
        [line("OK!")],
    ),
    "the longest line": (
        b"x" * MAX_HELD_BYTES + b"\n",
        [line("x" * MAX_HELD_BYTES, ending=1)],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_every_case_gives_its_items_however_it_is_cut(each_way, case):
    data, expected = CASES[case]
    assert each_way(data) == expected


def test_a_whole_frame_ends_what_was_too_long_and_a_line_may_follow_it():
    framer = LineFramer()
    assert framer.feed(b"x" * (MAX_HELD_BYTES + 1)) == []
    assert framer.feed(b"$a:1#OK!\r\n") == [frame("a", "1", trailing=5), line("OK!")]


def test_a_frame_comes_out_at_its_last_byte():
    framer = LineFramer()
    assert framer.feed(b"$data:1,2,3,4") == []
    assert framer.feed(b"#") == [frame("data", "1,2,3,4")]


def test_trailing_tells_how_many_bytes_of_the_chunk_came_later():
    framer = LineFramer()
    framer.feed(b"$a:1#$b:")
    items = framer.feed(b"2#\r\nOK!\r\n$c:")
    assert [item.trailing for item in items] == [10, 3]


@pytest.mark.parametrize(
    ("data", "counters"),
    [
        (b"$a:1#\r\n", {"bytes": 7, "frames": 1, "blank_bytes": 2}),
        (b"OK!\r\n\r\n", {"bytes": 7, "lines": 1, "blank_bytes": 2}),
        (b"$a:1,$b:2#", {"bytes": 10, "frames": 1, "broken_frames": 1, "discarded_bytes": 5}),
        (b"$a:1,\r\n", {"bytes": 7, "lines": 1, "broken_frames": 1}),
        (b"fail,Comm$b:2#", {"bytes": 14, "frames": 1, "discarded_bytes": 9}),
        (b"3,4#\r\n", {"bytes": 6, "blank_bytes": 2, "discarded_bytes": 4}),
        (b"\r$b:2#", {"bytes": 6, "frames": 1, "blank_bytes": 1}),
        (b"\xff\x00\x7f\n", {"bytes": 4, "lines": 1, "bad_bytes": 3}),
        (b"$" * 3, {"bytes": 3, "broken_frames": 2, "discarded_bytes": 2}),
        (b"x" * 161 + b"y\n", {"bytes": 163, "overlong": 1, "discarded_bytes": 163}),
        (b"x" * 161 + b"y#", {"bytes": 163, "overlong": 1, "discarded_bytes": 163}),
        (
            b"$" + b"x" * 300 + b"$b:2#",
            {"bytes": 306, "frames": 1, "overlong": 1, "discarded_bytes": 301},
        ),
    ],
)
def test_what_is_lost_is_counted(data, counters):
    framer = LineFramer()
    framer.feed(data)
    seen = {name: getattr(framer.counters, name) for name in framer.counters.__struct_fields__}
    assert {name: count for name, count in seen.items() if count} == counters


@given(streams)
def test_every_byte_is_accounted_for_once(parts):
    framer = LineFramer()
    items = framer.feed(b"".join(parts))
    counters = framer.counters
    assert counters.bytes == sum(map(len, parts))
    assert counters.bytes == (
        sum(item.size for item in items)
        + counters.blank_bytes
        + counters.discarded_bytes
        + framer.held_bytes
    )
    assert counters.frames == sum(isinstance(item, Frame) for item in items)
    assert counters.lines == sum(isinstance(item, TextLine) for item in items)


@given(streams)
def test_the_chunks_make_no_difference(parts):
    apart, whole, single = LineFramer(), LineFramer(), LineFramer()
    data = b"".join(parts)
    items = [(type(item), item.size) for item in whole.feed(data)]
    assert [(type(item), item.size) for part in parts for item in apart.feed(part)] == items
    assert [
        (type(item), item.size) for byte in data for item in single.feed(bytes([byte]))
    ] == items
    assert apart.counters == whole.counters == single.counters
    assert apart.held_bytes == whole.held_bytes == single.held_bytes


@given(streams)
def test_what_is_held_is_bounded(parts):
    framer = LineFramer()
    for part in parts:
        framer.feed(part)
        assert framer.held_bytes <= MAX_HELD_BYTES


@given(streams)
def test_a_frame_behind_64_newlines_is_always_found(parts):
    items = LineFramer().feed(b"".join(parts) + RESYNC + b"$MAll:1,-2,3,4#")
    assert items[-1] == frame("MAll", "1,-2,3,4")


@given(streams)
def test_a_frame_is_found_whatever_came_before(parts):
    items = LineFramer().feed(b"".join(parts) + b"$MAll:1,-2,3,4#")
    assert items[-1] == frame("MAll", "1,-2,3,4")


@given(st.binary(max_size=400))
def test_no_bytes_raise_and_no_item_hides_a_steering_byte(data):
    for item in LineFramer().feed(data):
        if isinstance(item, Frame):
            assert not set(item.name + item.args) & set("$#\n")
        else:
            assert item.text
            assert not set(item.text[1:]) & set("$#\n")


def test_a_resync_is_long_enough_for_the_board():
    assert set(RESYNC) == {0x0A}
    assert len(RESYNC) > 52


@given(st.lists(st.binary(max_size=40) | st.sampled_from([b"$", b"#", b"\n", b"\x1b[2J"])))
def test_no_text_of_a_board_can_command_a_terminal(parts: list[bytes]) -> None:
    for item in LineFramer().feed(b"".join(parts)):
        texts = (item.text,) if isinstance(item, TextLine) else (item.name, item.args)
        assert all(c.isprintable() or c == "\t" for text in texts for c in text)


def test_a_version_with_an_escape_sequence_is_still_read() -> None:
    [item] = LineFramer().feed(b"Motor_Version:1.7.3\x1b]0;mine\x07\r\n")
    assert item == TextLine(text="Motor_Version:1.7.3\ufffd]0;mine\ufffd", size=30, trailing=0)
