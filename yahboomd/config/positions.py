"""On which line of a TOML file each key stands, which ``tomllib`` does not tell.

The text is known to be valid TOML; so this reads just enough of the grammar to follow keys through
tables, arrays and strings. On anything else it stops, and the lines found so far are the answer.
"""

from __future__ import annotations

import contextlib
import re
import tomllib

from yahboomd.config.values import Place

_BLANK = re.compile(r"[ \t]*")
_GAP = re.compile(r"(?:[ \t\r\n]+|#[^\n]*)*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\n]+")
_STRING = re.compile(
    r'"""(?:[^\\]|\\.)*?"{3,5}'
    r"|'''.*?'{3,5}"
    r'|"(?:[^"\\\n]|\\.)*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)


def key_lines(text: str) -> dict[Place, int]:
    """The line (from 1) of every key, table and list entry of a valid TOML document."""
    reader = _Reader(text)
    with contextlib.suppress(_Stop, RecursionError):
        reader.document()
    return reader.lines


class _Stop(Exception):
    """Something that this reader does not follow."""


class _Reader:
    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._counted = 0
        self._line = 1
        self._tables: dict[Place, int] = {}
        self.lines: dict[Place, int] = {}

    def document(self) -> None:
        table: Place = ()
        while True:
            self._skip(_GAP)
            if self._at >= len(self._text):
                return
            if self._text[self._at] == "[":
                table = self._header()
            else:
                self._pair(table)

    def _header(self) -> Place:
        of_list = self._text.startswith("[[", self._at)
        self._at += 2 if of_list else 1
        place = self._resolve(self._key())
        if of_list:
            index = self._tables[place] = self._tables.get(place, -1) + 1
            self._note(place)
            place = (*place, index)
        self._note(place)
        self._expect("]]" if of_list else "]")
        return place

    def _resolve(self, key: Place) -> Place:
        # [[a]] then [a.b] speaks of the newest entry of a.
        place: Place = ()
        for part in key[:-1]:
            place = (*place, part)
            if place in self._tables:
                place = (*place, self._tables[place])
        return (*place, key[-1])

    def _pair(self, table: Place) -> None:
        start = self._at
        key = self._key()
        for end in range(1, len(key) + 1):
            self._note((*table, *key[:end]), at=start)
        self._expect("=")
        self._value((*table, *key))

    def _key(self) -> Place:
        parts: list[str] = []
        while True:
            self._skip(_BLANK)
            if quoted := _STRING.match(self._text, self._at):
                # The file's own parser knows the escapes.
                try:
                    parts.append(tomllib.loads(f"key = {quoted[0]}")["key"])
                except tomllib.TOMLDecodeError as error:
                    raise _Stop from error
                self._at = quoted.end()
            elif bare := _BARE.match(self._text, self._at):
                parts.append(bare[0])
                self._at = bare.end()
            else:
                raise _Stop
            self._skip(_BLANK)
            if not self._text.startswith(".", self._at):
                return tuple(parts)
            self._at += 1

    def _value(self, place: Place) -> None:
        self._skip(_BLANK)
        first = self._text[self._at : self._at + 1]
        if first == "[":
            self._list(place)
        elif first == "{":
            self._inline_table(place)
        elif found := _STRING.match(self._text, self._at) or _SCALAR.match(self._text, self._at):
            self._at = found.end()
        else:
            raise _Stop

    def _list(self, place: Place) -> None:
        self._at += 1
        index = 0
        while True:
            self._skip(_GAP)
            if self._text.startswith("]", self._at):
                self._at += 1
                return
            self._note((*place, index))
            self._value((*place, index))
            index += 1
            self._skip(_GAP)
            if self._text.startswith(",", self._at):
                self._at += 1

    def _inline_table(self, place: Place) -> None:
        self._at += 1
        while True:
            self._skip(_GAP)
            if self._text.startswith("}", self._at):
                self._at += 1
                return
            self._pair(place)
            self._skip(_GAP)
            if self._text.startswith(",", self._at):
                self._at += 1

    def _note(self, place: Place, at: int | None = None) -> None:
        upto = self._at if at is None else at
        self._line += self._text.count("\n", self._counted, upto)
        self._counted = upto
        self.lines.setdefault(place, self._line)

    def _skip(self, pattern: re.Pattern[str]) -> None:
        found = pattern.match(self._text, self._at)
        self._at = found.end() if found else self._at

    def _expect(self, token: str) -> None:
        self._skip(_BLANK)
        if not self._text.startswith(token, self._at):
            raise _Stop
        self._at += len(token)
