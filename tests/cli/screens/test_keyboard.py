from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.cli.screens.keyboard import ESCAPE, UNKNOWN, KeyParser, direction, wish

TYPED = {
    b"w": ["w"],
    b"wa": ["w", "a"],
    b"\x1b[A": ["up"],
    b"\x1b[B\x1b[D": ["down", "left"],
    b"\x1bOC": ["right"],
    # With shift or control held: the same arrow.
    b"\x1b[1;2A": ["up"],
    b"\x1b[3~": [UNKNOWN],
    b"\x1b[15~w": [UNKNOWN, "w"],
    b"\x1ba": [UNKNOWN],
    b"\x1b\x1b[A": [ESCAPE, "up"],
    "é→w".encode(): ["é", "→", "w"],
    b"\xff\x80w": [UNKNOWN, UNKNOWN, "w"],
    b"\x1b[\x01w": [UNKNOWN, "\x01", "w"],
}


@pytest.mark.parametrize(("data", "keys"), TYPED.items())
def test_keys_are_cut_from_what_a_terminal_sends(data: bytes, keys: list[str]) -> None:
    parser = KeyParser()
    assert parser.feed(data) == keys
    assert not parser.pending


@pytest.mark.parametrize(("data", "keys"), TYPED.items())
def test_keys_are_the_same_when_they_come_byte_by_byte(data: bytes, keys: list[str]) -> None:
    parser = KeyParser()
    assert [key for byte in data for key in parser.feed(bytes([byte]))] == keys


def test_an_arrow_in_two_pieces_is_never_the_letter_at_its_end() -> None:
    parser = KeyParser()
    assert parser.feed(b"\x1b[") == []
    assert parser.pending
    assert parser.feed(b"A") == ["up"]


def test_an_escape_that_nothing_follows_is_the_escape_key() -> None:
    parser = KeyParser()
    assert parser.feed(b"\x1b") == []
    assert parser.flush() == [ESCAPE]
    assert parser.flush() == []
    assert parser.feed(b"w") == ["w"]


@given(st.lists(st.binary(max_size=40)))
def test_no_bytes_raise_and_little_is_held(chunks: list[bytes]) -> None:
    parser = KeyParser()
    for chunk in chunks:
        parser.feed(chunk)
        assert len(parser._held) <= 32
    parser.flush()
    assert not parser.pending


@pytest.mark.parametrize(
    ("key", "signs"),
    [
        ("w", (1, 0, 0)),
        ("W", (1, 0, 0)),
        ("up", (1, 0, 0)),
        ("i", (1, 0, 0)),
        ("s", (-1, 0, 0)),
        (",", (-1, 0, 0)),
        ("a", (0, 0, 1)),
        ("left", (0, 0, 1)),
        ("d", (0, 0, -1)),
        ("l", (0, 0, -1)),
        ("u", (1, 0, 1)),
        ("o", (1, 0, -1)),
        ("J", (0, 1, 0)),
        ("L", (0, -1, 0)),
        ("k", None),
        (" ", None),
    ],
)
def test_keys_that_move(key: str, signs: tuple[int, int, int] | None) -> None:
    assert direction(key) == signs


@pytest.mark.parametrize(
    ("key", "meaning"),
    [
        ("up", "move"),
        ("+", "faster"),
        ("=", "faster"),
        ("-", "slower"),
        ("e", "estop"),
        ("E", "estop"),
        ("R", "release"),
        ("q", "quit"),
        ("\x03", "quit"),
    ],
)
def test_keys_that_ask_for_something(key: str, meaning: str) -> None:
    assert wish(key) == meaning


@pytest.mark.parametrize("key", [" ", "k", "x", "\r", ESCAPE, UNKNOWN, "\x1a", "é", "1"])
def test_every_other_key_stops(key: str) -> None:
    assert wish(key) == "stop"
