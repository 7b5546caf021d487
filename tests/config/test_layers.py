from __future__ import annotations

import os
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.config.layers import LARGEST_FILE_BYTES, NOWHERE, Layers, key_lines, toml_value


def words(layers: Layers) -> list[str]:
    return [words for _, words in layers.mistakes]


@pytest.fixture
def layers() -> Layers:
    return Layers({"limits": {"linear": {"velocity": 1.0, "jerk": 2.0}}, "zenoh": {}, "log": {}})


def test_a_byte_order_mark_and_windows_line_ends_are_no_mistake(layers, tmp_path):
    path = tmp_path / "config.toml"
    path.write_bytes(b'\xef\xbb\xbf[zenoh]\r\nnamespace = "bot"\r\n')
    layers.read_file(path)
    assert layers.data == {"zenoh": {"namespace": "bot"}}
    assert layers.origin(("zenoh", "namespace")).words == f"{path}:2"


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("[chassis]\nwheel_radius_m = 0,0335 # m", "a number has a decimal point, not a comma"),
        ("[limits]\nlinear = { velocity = -0,5 }", "a number has a decimal point, not a comma"),
        ("[serial]\nport = “/dev/ttyUSB0”", "its quotes are straight: \" or '"),
        ("[serial]\nport = \u2018/dev/ttyUSB0\u2019", "its quotes are straight: \" or '"),
        ("# mine\nserial:\n  port: /dev/ttyUSB0", "this looks like YAML or JSON, and the file is"),
        ('# mine\n{ "serial": { "port": 1 } }', "this looks like YAML or JSON, and the file is"),
        ("\n- serial", "this looks like YAML or JSON, and the file is"),
    ],
)
def test_habits_of_other_languages_get_what_toml_wants(layers, tmp_path, written, meant):
    path = tmp_path / "config.toml"
    path.write_text(f"{written}\n", encoding="utf-8")
    layers.read_file(path)
    ((origin, words),) = layers.mistakes
    assert origin.words == f"{path}:2"
    assert f"; {meant}" in words


@pytest.mark.parametrize(
    ("content", "line", "expected"),
    [
        (b"[log]\nlevel = \n", 2, "not valid TOML: Invalid value (at line 2, column 9)"),
        (
            b"[serial]\nport = /dev/ttyUSB0 # the board\n",
            2,
            (
                "not valid TOML: Invalid value (at line 2, column 8); text needs quotes: "
                'port = "..."'
            ),
        ),
        (
            b"[chassis]\npreset = 4wd\n",
            2,
            (
                "not valid TOML: Expected newline or end of document after a statement "
                '(at line 2, column 11); text needs quotes: preset = "..."'
            ),
        ),
        (
            b"[log]\n[log]\n",
            2,
            "not valid TOML: Cannot declare ('log',) twice (at line 2, column 5)",
        ),
        (
            b'[log]\nlevel = """\n',
            2,
            "not valid TOML: Unterminated string (at end of document)",
        ),
        (b"[log]\nlevel = '\xff'\n", 2, "not UTF-8 (byte 0xff); save it as UTF-8"),
        (b"x = 1\n" + b"a." * 400_000 + b"a = 1\n", 2, "a key of too many parts, so not a config"),
        (b"a = " + b"[" * 5000, 0, "tables or lists are nested too deeply"),
        (b"a = " + b"9" * 5000, 0, "not valid TOML: "),
        (b"#" * (LARGEST_FILE_BYTES + 1), 0, "larger than 1000000 bytes, so not a configuration"),
    ],
)
def test_a_file_that_is_no_toml_is_explained_with_its_line(
    layers, tmp_path, content, line, expected
):
    path = tmp_path / "config.toml"
    path.write_bytes(content)
    layers.read_file(path)
    ((origin, why),) = layers.mistakes
    assert why.startswith(expected)
    assert origin.words == (f"{path}:{line}" if line else str(path))
    assert layers.data == {}


DOTS = "." * 400


@pytest.mark.parametrize(
    "written",
    [
        f"x = 1 # {DOTS}",
        f"# don't {DOTS}\nx = 1",
        f'x = "{DOTS}"',
        f"x = '{DOTS}'",
        f'x = "\\"{DOTS}" # {DOTS}',
        f'x = """\n{DOTS}\n\\"""{DOTS}"""',
        f"x = '''\n'{DOTS}\n'''",
        "x = [" + ", ".join(["0.5"] * 400) + "]",
        f'"{DOTS}" = 1\nx = 1',
    ],
)
def test_dots_outside_of_a_key_are_no_mistake(layers, tmp_path, written):
    path = tmp_path / "config.toml"
    path.write_text(f"{written}\n")
    layers.read_file(path)
    assert layers.mistakes == []
    assert "x" in layers.data


@pytest.mark.parametrize(
    "written",
    ["{a} = 1", "[{a}]", "x = {{y = 1, {a} = 2}}", "'''\n'''.{a} = 1", "x = '' # '\n{a} = 1"],
)
@pytest.mark.parametrize("part", ["a", "'a'", '"a"', '" \\" "', "a "])
def test_a_key_of_too_many_parts_is_found_behind_texts_and_comments(
    layers, tmp_path, written, part
):
    path = tmp_path / "config.toml"
    text = written.format(a=".".join([part] * 300))
    path.write_text(text)
    layers.read_file(path)
    line = text.count("\n") + 1
    assert [(at.words, why) for at, why in layers.mistakes] == [
        (f"{path}:{line}", "a key of too many parts, so not a configuration")
    ]


@pytest.mark.parametrize("unit", ["a.", '"', '\\"', "'", '"""', "'''", ". ", "a"])
def test_a_megabyte_of_anything_is_refused_at_once(layers, tmp_path, unit):
    path = tmp_path / "config.toml"
    path.write_text("x." * 201 + unit * (LARGEST_FILE_BYTES // len(unit) - 500))
    layers.read_file(path)
    assert len(layers.mistakes) == 1


def test_a_directory_instead_of_a_file_is_named_as_such(layers, tmp_path):
    layers.read_file(tmp_path)
    assert words(layers) == ["cannot be read: Is a directory"]


def test_a_file_that_may_not_be_read_is_named_as_such(layers, tmp_path):
    path = tmp_path / "config.toml"
    path.touch(mode=0)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)  # root may read everything
    try:
        layers.read_file(path)
    finally:
        if user == 0:
            os.seteuid(0)
    assert words(layers) == ["cannot be read: Permission denied"]


def test_the_environment_names_sections_and_keys_with_two_underscores(layers):
    layers.read_environment({"YAHBOOMD_LIMITS__LINEAR__VELOCITY": " 0.5 ", "HOME": "/", "LOG": "x"})
    assert layers.data == {"limits": {"linear": {"velocity": 0.5, "jerk": 2.0}}}
    assert layers.mistakes == []


@pytest.mark.parametrize("name", ["YAHBOOMD_ZENOH_NAMESPACE", "YAHBOOMD_LOG"])
def test_a_variable_with_one_underscore_is_a_mistake_not_ignored(layers, name):
    layers.read_environment({name: "x"})
    assert words(layers)[0].startswith("expected two underscores")


def test_variables_of_others_are_let_alone(layers):
    layers.read_environment({"YAHBOOMD_SERVICE_HOST": "10.0.0.1", "YAHBOOMD": "1"})
    assert (layers.data, layers.mistakes) == ({}, [])


@pytest.mark.parametrize(
    "override",
    [
        'sources."cmd_vel/teleop".priority=5',
        "sources.'cmd_vel/teleop'.priority = 5",
        # The text after a shell has removed the quotes.
        "sources.cmd_vel/teleop.priority=5",
    ],
)
def test_names_with_slashes_may_be_quoted_or_not(layers, override):
    layers.read_overrides([override])
    assert layers.data == {"sources": {"cmd_vel/teleop": {"priority": 5}}}


def test_an_equals_sign_in_quotes_belongs_to_the_name(layers):
    layers.read_overrides(['a."b=c"=1=2'])
    assert layers.data == {"a": {"b=c": "1=2"}}


@pytest.mark.parametrize("override", ["", "zenoh", "=1", "zenoh=1", "zenoh.=1", ".a=1", "a..b=1"])
def test_an_override_without_section_key_and_value_is_a_mistake(layers, override):
    layers.read_overrides([override])
    assert words(layers)[0].startswith("expected section.key=value")
    assert layers.data == {}


def test_a_value_that_is_not_utf8_is_a_mistake_at_its_key(layers):
    layers.read_environment({"YAHBOOMD_SERIAL__PORT": "/dev/\udcff"})
    layers.read_overrides(['serial.port="/tmp/\udcfe"'])
    assert words(layers) == [
        "serial.port: it is not UTF-8",
        "serial.port: it is not UTF-8",
    ]
    assert layers.data == {}


def test_an_override_takes_the_place_of_what_is_no_table(layers, tmp_path):
    path = tmp_path / "config.toml"
    path.write_text("limits = 3\n")
    layers.read_file(path)
    layers.read_overrides(["limits.linear.velocity=2"])
    assert layers.data == {"limits": {"linear": {"velocity": 2, "jerk": 2.0}}}


def test_an_origin_is_that_of_the_nearest_table_else_of_what_is_in_it(layers):
    layers.read_overrides(["limits.linear.velocity=2"])
    assert layers.origin(("limits", "linear", "velocity", "x")).words.startswith("--set")
    assert layers.origin(("limits",)).words.startswith("--set")
    assert layers.origin(("log", "level")) == NOWHERE


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("web.camera=http://robot/?psw=hunter2", "--set web.camera"),
        ("camera=http://me:hunter2@robot", "--set camera"),
        ("web.camera:http://me:hunter2@robot", "--set web.camera"),
        ("web.camera http://me:hunter2@robot", "--set web.camera"),
        (
            'command.sources."cmd_vel/a".priority=hunter2\n',
            '--set command.sources."cmd_vel/a".priority',
        ),
    ],
)
def test_the_origin_of_an_override_has_no_value(layers, override, words):
    layers.read_overrides([override])
    origins = [origin for origin, _ in (*layers.written.values(), *layers.mistakes)]
    assert [origin.words for origin in origins] == [words]


@pytest.mark.parametrize(
    "line",
    ["camera = http://me:hunter2@robot", "camera = http://robot/?psw=hunter2",
     "camera: http://robot/?psw=hunter2", 'camera = "http://robot/?psw=hunter2',
     'camera = http://robot/?psw="hunter2"', "password = hunter2", "hunter2"],
)  # fmt: skip
def test_a_line_that_is_no_toml_is_not_repeated(layers, tmp_path, line):
    path = tmp_path / "config.toml"
    path.write_text(f"[web]\n{line}\n")
    layers.read_file(path)
    ((origin, why),) = layers.mistakes
    assert origin.words == f"{path}:2"
    assert "hunter2" not in why


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("1.0", 1.0),
        (" true ", True),
        ("False", False),
        ('"1"', "1"),
        ("[1, 'a']", [1, "a"]),
        ("{ a = 1 }", {"a": 1}),
        ("/dev/ttyUSB0", "/dev/ttyUSB0"),
        ("", ""),
        ("1\nother = 2", "1\nother = 2"),
        ("[" * 5000, "[" * 5000),
    ],
)
def test_a_value_is_toml_where_it_can_be_else_text(text, value):
    assert toml_value(text) == value
    assert type(toml_value(text)) is type(value)


def test_a_name_that_is_not_utf_8_is_a_mistake(layers):
    layers.read_environment({"YAHBOOMD_\udcff__X": "1"})
    ((origin, said),) = layers.mistakes
    assert origin.words == "YAHBOOMD_?__X"
    assert "?" in said
    assert "it is not UTF-8" in said


TEXT = '''\
# a comment with [brackets] and "quotes
top = 1  # first
[serial]
port = "a # b"
text = """
[not.a.table]
key = 1
"""
raw = \'\'\'
x = 2\'\'\'
after = 'it = 1'
[chassis . "a b"]
list = [
  { position = 1 },  # [
  { position = 2, name = "x]" },
]
a.b."c.d" = { e = 1, f = [1, 2] }
last = 1979-05-27 07:32:00
[[many.entries]]
one = 1
[[many.entries]]
one = 2
[many.entries.sub]
two = 1
'''


def every_place(value, place=()):
    if place:
        yield place
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in items:
        if isinstance(item, dict | list):
            yield from every_place(item, (*place, key))
        else:
            yield (*place, key)


def test_every_key_of_every_kind_of_table_is_found_on_its_line():
    lines = key_lines(TEXT)
    assert lines[("top",)] == 2
    assert lines[("serial",)] == 3
    assert lines[("serial", "port")] == 4
    assert lines[("serial", "text")] == 5
    assert lines[("serial", "raw")] == 9
    assert lines[("serial", "after")] == 11
    assert lines[("chassis", "a b")] == 12
    assert lines[("chassis", "a b", "list", 0, "position")] == 14
    assert lines[("chassis", "a b", "list", 1, "name")] == 15
    assert lines[("chassis", "a b", "a", "b", "c.d", "f", 1)] == 17
    assert lines[("chassis", "a b", "last")] == 18
    assert lines[("many", "entries", 0, "one")] == 20
    assert lines[("many", "entries", 1, "one")] == 22
    assert lines[("many", "entries", 1, "sub", "two")] == 24


def test_no_key_is_missed_and_none_invented():
    found = set(key_lines(TEXT))
    known = set(every_place(tomllib.loads(TEXT)))
    assert found == known


keys = st.one_of(
    st.from_regex(r"[A-Za-z0-9_-]{1,4}", fullmatch=True), st.sampled_from(['"a.b"', "'#'"])
)
scalars = st.sampled_from(['"#"', "1", "true", "'''a\n= b'''", '"""\n[x]\n"""', "1.5e3", '"\\""'])
tables = st.lists(st.sampled_from(["1", "true", '"#"', "[1, 2]"]), max_size=2).map(
    lambda items: "{ " + ", ".join(f"k{n} = {item}" for n, item in enumerate(items)) + " }"
)
lists = st.lists(st.one_of(scalars, tables), max_size=3).map(
    lambda items: "[\n" + ", # c\n".join(items) + "]"
)
values = st.one_of(
    scalars,
    tables,
    lists,
    st.lists(lists, max_size=2).map(lambda items: "[" + ",\n".join(items) + "\n]"),
)


@given(st.lists(st.tuples(keys, values), max_size=6), st.sampled_from(["", "[t]\n", "[[t]]\n"]))
def test_the_lines_of_any_document_are_those_where_its_keys_stand(pairs, header):
    text = header + "\n".join(f"{key} = {value}" for key, value in pairs)
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return  # a key given twice
    lines = key_lines(text)
    assert set(every_place(document)) == set(lines)
    rows = text.split("\n")
    for place, line in lines.items():
        name = next((part for part in reversed(place) if isinstance(part, str)), "")
        if isinstance(place[-1], str):
            assert name in rows[line - 1]


@given(st.text(alphabet="[]{}=\"'#.,\n\\ab1 \t", max_size=60))
def test_text_that_is_no_toml_does_not_raise(text):
    assert isinstance(key_lines(text), dict)
