"""The line of each key in a TOML file, which ``tomllib`` does not report.

``tomllib`` itself reads the file again, statement by statement, so there is no second grammar. That
takes many times as long as reading it once: ask only when a line is to be shown.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator

from yahboomd.core.config.values import Place

LONGEST_STATEMENT = 200
"""Lines of one value; no line is found behind a longer one."""

_ENDS = ("", "\n]", "\n]]", '\n"""', "\n'''")
"""The end of a statement: nothing, or on its first lines the end of its list or text."""


def key_lines(text: str) -> dict[Place, int]:
    """The line (from 1) of every key, table and list entry of a valid TOML document."""
    lines: dict[Place, int] = {}
    newest: dict[Place, int] = {}
    table: Place = ()
    start, statement = 1, ""
    for number, line in enumerate(text.split("\n"), start=1):
        statement += f"{line}\n"
        for end in _ENDS:
            try:
                read = tomllib.loads(statement + end)
            except (ValueError, RecursionError):
                continue
            if statement.lstrip().startswith("["):
                table = _header(read, newest)
                found = [table[:length] for length in range(1, len(table) + 1)]
            else:
                found = [(*table, *place) for place in _places(read)]
            for place in found:
                lines.setdefault(place, number)
            if not end:
                start, statement = number + 1, ""
            break
        if number - start > LONGEST_STATEMENT:
            break
    return lines


def _header(read: object, newest: dict[Place, int]) -> Place:
    """The table that ``[a.b]`` or ``[[a.b]]`` opens; in a list of tables, its newest entry."""
    place: Place = ()
    while isinstance(read, dict) and read:
        ((key, read),) = read.items()
        place = (*place, key)
        if isinstance(read, list):
            newest[place] = newest.get(place, -1) + 1
        if place in newest:
            place = (*place, newest[place])
    return place


def _places(value: object, place: Place = ()) -> Iterator[Place]:
    if place:
        yield place
    items = value.items() if isinstance(value, dict) else ()
    for key, item in enumerate(value) if isinstance(value, list) else items:
        yield from _places(item, (*place, key))
