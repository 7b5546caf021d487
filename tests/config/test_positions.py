from __future__ import annotations

import tomllib

from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.config.positions import key_lines

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
