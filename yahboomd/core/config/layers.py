"""The layers of a configuration, one over the other: file, calibration, environment, ``--set``.

Each value keeps its origin, so that a mistake is reported with its file and line.
"""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from yahboomd.core.config.reading import read_named
from yahboomd.core.config.values import Place, dotted
from yahboomd.core.names import NOT_UTF8, is_utf8

PREFIX = "YAHBOOMD_"
"""The names of our environment variables start with it."""

LARGEST_FILE_BYTES = 1_000_000
"""A configuration is a few kilobytes; more is another file, or a device that never ends."""

MOST_DOTS = 200
"""In a key."""

LONGEST_STATEMENT = 200
"""Lines of one value; no line is found behind a longer one."""

_ENDS = ("", "\n]", "\n]]", '\n"""', "\n'''")
"""The end of a statement: nothing, or on its first lines the end of its list or text."""

_QUOTED = re.compile(
    r'"""(?:\\.|[^\\])*?(?:"""|\Z)|"(?:\\.|[^"\\\n])*"?'
    r"|'''.*?(?:'''|\Z)|'[^'\n]*'?|#[^\n]*",
    re.DOTALL,
)
"""A text, up to its end or the document's, or a comment of TOML."""

_LINE = re.compile(r"\(at line (\d+), column \d+\)$")
_BARE_TEXT = re.compile(
    r"""\s*(?P<key>[\w."'-]+)\s*=\s*(?!true\b|false\b|inf\b|nan\b)"""
    r"""[\w./:~@+-]*[A-Za-z/][^"'\[{]*"""
)
"""A line of TOML whose value is text without its quotes."""

_MISTYPED = {
    r".*[\u2018-\u201f\xab\xbb]": "its quotes are straight: \" or '",
    r".*=\s*[-+]?\d+,\d+\s*([,}#]|$)": "a number has a decimal point, not a comma",
    r"""["'\w.-]+\s*:(\s|$)|- |\{""": "this looks like YAML or JSON, and the file is TOML",
}
"""Mistakes of people who write TOML seldom: the line that has one, and what TOML wants."""

_PART = r"""(?:\s*"[^"]*"\s*|\s*'[^']*'\s*|[^."'=]+)"""
_OVERRIDE = re.compile(rf"(?P<key>{_PART}(?:\.{_PART})+)=(?P<value>.*)", re.DOTALL)
"""More lenient than TOML: shells eat the quotes of command.sources."cmd_vel/teleop".priority."""


class Origin(NamedTuple):
    """The origin of a value; sorts as the layers do, then by line."""

    layer: int
    line: int
    words: str

    @property
    def in_file(self) -> bool:
        return self.layer == 0


NOWHERE = Origin(-1, 0, "")
"""The origin of a default."""


@dataclass
class Layers:
    """The values of the layers that were read.

    Attributes:
        defaults: The whole configuration without any layer, as in a file.
        data: The values, nested as in the file.
        written: Keys from environment and ``--set`` in order: the origin, and the letters.
        mistakes: Each origin that could not be read at all, and why.
    """

    defaults: Mapping[str, Any]
    data: dict[str, Any] = field(default_factory=dict)
    written: dict[Place, tuple[Origin, str]] = field(default_factory=dict)
    mistakes: list[tuple[Origin, str]] = field(default_factory=list)
    _path: str = ""
    _text: str = ""

    @cached_property
    def origins(self) -> dict[Place, Origin]:
        """The origin of each key that was written; slow, ask after everything is read."""
        found = {
            place: Origin(0, line, f"{self._path}:{line}")
            for place, line in key_lines(self._text).items()
        }
        for place, (origin, _) in self.written.items():
            found = {key: at for key, at in found.items() if key[: len(place)] != place}
            found[place] = origin
        return found

    def origin(self, place: Place) -> Origin:
        """The origin of ``place`` or of the nearest table around it; NOWHERE for a default.

        The origin of a table without a header is that of its first key.
        """
        for end in range(len(place), 0, -1):
            if place[:end] in self.origins:
                return self.origins[place[:end]]
        inside = (at for key, at in self.origins.items() if key[: len(place)] == place)
        return min(inside, default=NOWHERE)

    def read_file(self, path: Path) -> None:
        """Take the values of a TOML file, or note the reason why that is impossible."""
        self._path = plain(str(path))
        try:
            raw = read_named(path, LARGEST_FILE_BYTES + 1)
        except OSError as error:
            self._refuse(f"cannot be read: {error.strerror}")
            return
        if len(raw) > LARGEST_FILE_BYTES:
            self._refuse(f"larger than {LARGEST_FILE_BYTES} bytes, so not a configuration")
            return
        try:
            # Windows editors put a byte order mark in front, which TOML does not know.
            text = raw.decode("utf-8-sig").replace("\r\n", "\n")
            if line := _line_of_endless_key(text):
                self._refuse("a key of too many parts, so not a configuration", line)
                return
            self.data, self._text = tomllib.loads(text), text
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            self._refuse(f"not UTF-8 (byte 0x{raw[error.start]:02x}); save it as UTF-8", line)
        except tomllib.TOMLDecodeError as error:
            self._refuse(*_explained(str(error), text))
        except ValueError as error:
            self._refuse(f"not valid TOML: {error}")
        except RecursionError:
            self._refuse("tables or lists are nested too deeply")

    def take(self, place: tuple[str, ...], value: object, words: str) -> None:
        """Take a calibrated value over that of the file, unless one was given over both.

        Args:
            words: Its origin.
        """
        if not any(key[: len(place)] == place for key in self.written):
            self._put(place, value, Origin(1, 0, words), "")

    def read_environment(self, environ: Mapping[str, str]) -> None:
        """Take every ``YAHBOOMD_SECTION__KEY``; similar names belong to other programs.

        A name with a section and only one underscore is a mistake.
        """
        for name in sorted(name for name in environ if name.startswith(PREFIX)):
            rest = name.removeprefix(PREFIX).lower()
            place, origin = tuple(rest.split("__")), Origin(2, 0, plain(name))
            section = next((s for s in self.defaults if f"{rest}_".startswith(f"{s}_")), None)
            if len(place) > 1 and all(place):
                self._set(place, environ[name], origin)
            elif section is not None:
                key = rest.removeprefix(section).strip("_") or "key"
                right = f"{PREFIX}{section}__{key}".upper()
                words = f"expected two underscores between section and key, such as {right}"
                self.mistakes.append((origin, words))

    def read_overrides(self, overrides: Sequence[str]) -> None:
        """Take each ``section.key=value`` of ``--set``, the later over the earlier."""
        for number, override in enumerate(overrides):
            # Without its value, which may be a secret.
            origin = Origin(3, number, "--set " + re.split(r"""[^\w."'/-]""", override)[0])
            found = _OVERRIDE.fullmatch(override)
            if found is None:
                self.mistakes.append((origin, "expected section.key=value"))
                continue
            parts = re.findall(_PART, found["key"])
            self._set(tuple(part.strip(" \t\"'") for part in parts), found["value"], origin)

    def _set(self, place: tuple[str, ...], text: str, origin: Origin) -> None:
        if not is_utf8("".join((*place, text))):
            self.mistakes.append((origin, plain(f"{dotted(place)}: {NOT_UTF8}")))
            return
        self._put(place, toml_value(text), origin, text)

    def _put(self, place: tuple[str, ...], value: object, origin: Origin, text: str) -> None:
        # A single key changes that key alone: a table that the file left out starts as the default.
        table: dict[str, Any] = self.data
        default: Any = self.defaults
        for part in place[:-1]:
            default = default.get(part, {}) if isinstance(default, Mapping) else {}
            if not isinstance(table.get(part), dict):
                table[part] = copy.deepcopy(default) if isinstance(default, dict) else {}
            table = table[part]
        table[place[-1]] = value
        self.written = {key: at for key, at in self.written.items() if key[: len(place)] != place}
        self.written[place] = (origin, text)

    def _refuse(self, words: str, line: int = 0) -> None:
        at = f"{self._path}:{line}" if line else self._path
        self.mistakes.append((Origin(0, line, at), words))


def plain(text: str) -> str:
    return "".join(char if char.isprintable() else "?" for char in text)


def toml_value(text: str) -> object:
    """A value as TOML reads it, else the text itself; ``True`` is meant as TOML's ``true``."""
    text = text.strip()
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    if "\n" in text:
        return text
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text


def _line_of_endless_key(text: str) -> int:
    """The line with a key of too many parts, on which tomllib would spend minutes; else 0."""
    if all(line.count(".") <= MOST_DOTS for line in text.split("\n")):
        return 0
    bare = _QUOTED.sub(lambda found: "\n" * found[0].count("\n"), text)
    lines = enumerate(bare.split("\n"), start=1)
    return next((number for number, line in lines if _dots_of_key(line) > MOST_DOTS), 0)


def _dots_of_key(line: str) -> int:
    """The most dots with nothing but letters and digits between them."""
    return max(words.count(".") for words in re.split(r"[^\w\s.-]+", line))


def _explained(error: str, text: str) -> tuple[str, int]:
    """A syntax error of ``tomllib`` with the line, and what was most likely meant."""
    at = _LINE.search(error)
    line = int(at[1]) if at else text.rstrip().count("\n") + 1
    # The line is not repeated: it may have a secret.
    words = text.split("\n")[line - 1].strip()
    bare = _BARE_TEXT.fullmatch(words)
    hint = f'; text needs quotes: {bare["key"]} = "..."' if bare else ""
    hint = next((f"; {meant}" for each, meant in _MISTYPED.items() if re.match(each, words)), hint)
    return f"not valid TOML: {error}{hint}", line


def key_lines(text: str) -> dict[Place, int]:
    """The line (from 1) of every key, table and list entry of a valid TOML document.

    ``tomllib`` does not report lines. It reads the file again, statement by statement, so there is
    no second grammar. That takes many times as long: ask only when a line is to be shown.
    """
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
