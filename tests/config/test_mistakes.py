from __future__ import annotations

import pytest

from yahboomd.config.layers import Origin
from yahboomd.config.mistakes import Mistake, section_of, shown, slot, suggestion


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[serail]\n", 'serail: unknown section; did you mean "serial"?'),
        ("[command]\ntimeout = 1.0\n", 'command.timeout: unknown key; did you mean "timeout_s"?'),
        ("[command]\nframe_id = 'x'\n", 'command.frame_id: unknown key; "frame_id" belongs to'),
        ("motors = 3\n", 'motors: unknown section; "motors" belongs to [chassis]'),
        (
            "[chassis]\ncommand_sign = -1\n",
            "belongs to each entry of chassis.motors: { position = \u2026, command_sign = \u2026 }",
        ),
        ("[log]\nxyzzy = 1\n", "log.xyzzy: unknown key; known here: level"),
        ("serial = 3\n", "serial: expected a table { port, baudrate, dialect, "),
        ("[serial]\nbaudrate = '115200'\n", 'got "115200" (a number takes no quotes)'),
        ("[serial]\nbaudrate = 115200.0\n", "expected a whole number from 1200 to 4000000"),
        ("[serial]\nport = 3\n", "serial.port: expected text, got 3 (text needs quotes)"),
        ("[serial]\ndtr = 1\n", "serial.dtr: expected true or false, got 1"),
        ("[serial]\nport = 1979-05-27\n", "expected text, got 1979-05-27"),
        ("[limits]\nlinear = 3\n", "expected a table { velocity, acceleration, deceleration, jerk"),
        ("[limits]\nlinear = { velocity = nan }\n", "expected a number greater than 0, got nan"),
        ("[board]\nprofile = 'tt-none'\n", "(a TT motor without encoder is refused: it gives no"),
        ("[zenoh]\nlisten = 'tcp/[::]:1'\n", 'got "tcp/[::]:1" (a list stands in [ ])'),
        ("[zenoh]\nnamespace = '/bot'\n", 'expected a name such as "bot1" or "fleet/bot1", or "",'),
        ("[command.sources.'a/']\n", 'command.sources."a/": expected a key such as "cmd_vel"'),
        ("[chassis.motors]\nleft = []\n", "expected at least 1 entries, got 0"),
        ("[chassis.motors]\nleft = [{}]\n", "left[0].position: missing; expected a whole number"),
        ("[chassis.motors]\nleft = { position = 1 }\n", "(a list stands in [ ])"),
    ],
)
def test_a_mistake_says_what_was_expected_and_what_was_found(complaints, text, words):
    assert any(words in line for line in complaints(text)), complaints(text)


def test_a_mistake_is_one_line_with_origin_place_and_words():
    assert str(Mistake(Origin(0, 12, "config.toml:12"), "a.b", "wrong")) == (
        "config.toml:12: a.b: wrong"
    )
    assert str(Mistake(Origin(0, 0, "config.toml"), "", "no such file")) == (
        "config.toml: no such file"
    )


def test_a_mistake_stays_on_its_line_whatever_was_typed():
    mistake = Mistake(Origin(2, 0, "--set a\n=1"), "a.\ufeff", "such as \x0e\x00")
    assert str(mistake) == "--set a?=1: a.?: such as ??"


def test_mistakes_sort_as_they_were_written():
    late, early = Mistake(Origin(0, 10, "f:10"), "a", "x"), Mistake(Origin(0, 9, "f:9"), "b", "x")
    assert sorted([late, early]) == [early, late]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (True, "true"),
        ("a\nb", '"a\\nb"'),
        ([1, "x"], '[1, "x"]'),
        ({"a b": {}}, '{ "a b" = {} }'),
        (float("inf"), "inf"),
    ],
)
def test_a_value_is_shown_as_toml_writes_it(value, words):
    assert shown(value) == words


def test_a_number_too_long_for_python_to_write_is_shown_by_its_length():
    assert shown(1 << 30_000) == "a number of 30001 bits"


def test_a_long_value_is_cut():
    assert len(shown("x" * 10_000)) == 60


def test_a_name_that_resembles_none_lists_all():
    assert suggestion("qqq", ["a", "b"]) == "; known here: a, b"
    assert suggestion("Moed", ["mode", "listen"]) == '; did you mean "mode"?'
    assert suggestion("x", []) == ""


def test_a_key_of_several_sections_belongs_to_none_of_them():
    assert section_of("frame_id") == "odometry"
    assert section_of("nothing") is None


def test_the_models_know_every_place_and_no_other():
    assert slot(("limits", "linear", "jerk")) is not None
    assert slot(("chassis", "motors", "left", 0, "position")) is not None
    assert slot(("command", "sources", "any/thing", "priority")) is not None
    assert slot(("zenoh", "listen", 3)) is not None
    for place in [("x",), ("serial", "x"), ("serial", "port", "x"), ("zenoh", "listen", "x")]:
        assert slot(place) is None
