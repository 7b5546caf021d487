"""The layers of a configuration, one over the other: file, environment, ``--set``.

Each value keeps its origin, so that a mistake can be found where it was written.
"""

from __future__ import annotations

import copy
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from yahboomd.config.positions import key_lines
from yahboomd.config.values import Place

PREFIX = "YAHBOOMD_"
"""What the names of our environment variables start with."""

LARGEST_FILE_BYTES = 1_000_000
"""A configuration is a few kilobytes; more is another file, or a device that never ends."""

DEEPEST = 20
"""Levels of tables and lists that are looked at."""

_SYNTAX = re.compile(r"(?P<why>.*) \(at (?:line (?P<line>\d+), column (?P<column>\d+)|.*)\)")
_BARE_TEXT = re.compile(
    r"""\s*[\w."'-]+\s*=\s*(?!true\b|false\b|inf\b|nan\b)"""
    r"""(?P<text>[\w./:~@+-]*[A-Za-z/][\w./:~@+ -]*)(?:#.*)?"""
)
"""A line of TOML whose value is text without its quotes."""

_TUPLE = re.compile(r"\((?:'[^']*'(?:, |,)?)+\)")
_KEY_PART = re.compile(r"""\s*(?:"([^"]*)"|'([^']*)'|([^."'=]+?))\s*(?:\.|$)""")


@dataclass(frozen=True, order=True)
class Origin:
    """Where a value was written; sorts as the layers do, then by line."""

    layer: int
    line: int
    words: str

    @property
    def in_file(self) -> bool:
        """Whether in a file, rather than in the environment or on the command line."""
        return self.layer == 0


NOWHERE = Origin(-1, 0, "")
"""The source of a default."""


@dataclass
class Layers:
    """What was read so far.

    Attributes:
        data: The values, nested as in the file.
        origins: Where each key was written.
        texts: What environment and ``--set`` gave in letters, for keys that take text.
        mistakes: What could not be read at all, with its origin.
    """

    defaults: Mapping[str, Any]
    data: dict[str, Any] = field(default_factory=dict)
    origins: dict[Place, Origin] = field(default_factory=dict)
    texts: dict[Place, str] = field(default_factory=dict)
    mistakes: list[tuple[Origin, str]] = field(default_factory=list)

    def origin(self, place: Place) -> Origin:
        """Where ``place``, or the nearest table around it, was written; NOWHERE for a default.

        A table that was never written as such is where the first key in it was.
        """
        for end in range(len(place), 0, -1):
            if place[:end] in self.origins:
                return self.origins[place[:end]]
        inside = (at for key, at in self.origins.items() if key[: len(place)] == place)
        return min(inside, default=NOWHERE)

    def read_file(self, path: Path) -> None:
        """Take the values of a TOML file, or note why that is impossible."""
        name = plain(str(path))
        try:
            with path.open("rb") as file:
                raw = file.read(LARGEST_FILE_BYTES + 1)
        except OSError as error:
            self.mistakes.append((Origin(0, 0, name), _why_unreadable(error)))
            return
        if len(raw) > LARGEST_FILE_BYTES:
            words = f"larger than {LARGEST_FILE_BYTES} bytes, so not a configuration"
            self.mistakes.append((Origin(0, 0, name), words))
            return
        try:
            # Windows editors put a byte order mark in front, which TOML does not know.
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            words = f"not UTF-8 (byte 0x{raw[error.start]:02x}); save the file as UTF-8"
            self.mistakes.append((Origin(0, line, f"{name}:{line}"), words))
            return
        text = text.replace("\r\n", "\n")
        try:
            self.data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            self.mistakes.append(_syntax(name, str(error), text))
            return
        except (ValueError, RecursionError) as error:
            why = "nested too deeply" if isinstance(error, RecursionError) else str(error)
            self.mistakes.append((Origin(0, 0, name), f"not valid TOML: {why}"))
            return
        if not _is_shallow(self.data):
            self.data = {}
            self.mistakes.append((Origin(0, 0, name), "tables or lists are nested too deeply"))
            return
        for place, line in key_lines(text).items():
            self.origins[place] = Origin(0, line, f"{name}:{line}")

    def read_environment(self, environ: Mapping[str, str]) -> None:
        """Take every ``YAHBOOMD_SECTION__KEY``; others that start alike belong to somebody else.

        One that names a section and forgets the second underscore is a mistake rather than
        ignored.
        """
        for name in sorted(environ):
            if not name.startswith(PREFIX):
                continue
            rest = name.removeprefix(PREFIX).lower()
            place = tuple(rest.split("__"))
            if len(place) > 1 and all(place):
                self._set(place, environ[name], Origin(1, 0, plain(name)))
                continue
            section = next((s for s in self.defaults if rest == s or rest.startswith(f"{s}_")), "")
            if section:
                key = rest.removeprefix(section).strip("_") or "key"
                right = f"{PREFIX}{section}__{key}".upper()
                words = f"expected two underscores between section and key, such as {right}"
                self.mistakes.append((Origin(1, 0, plain(name)), words))

    def read_overrides(self, overrides: Sequence[str]) -> None:
        """Take each ``section.key=value`` of ``--set``, the later over the earlier."""
        for number, override in enumerate(overrides):
            name, value = _split(override)
            origin = Origin(2, number, f"--set {plain(override)}")
            if value is None:
                self.mistakes.append((origin, "expected section.key=value"))
                continue
            place = tuple(_parts(name))
            if len(place) < 2 or not all(place):
                self.mistakes.append((origin, "expected section.key=value, with a section"))
                continue
            self._set(place, value, origin)

    def forget(self, place: Place) -> None:
        """Drop what is known of the origin of a key, and of all below it."""
        for known in (self.origins, self.texts):
            for key in [key for key in known if key[: len(place)] == place]:
                known.pop(key)

    def _set(self, place: tuple[str, ...], text: str, origin: Origin) -> None:
        # A single key changes that key alone: a table that the file left out starts as the default.
        table: dict[str, Any] = self.data
        default: Any = self.defaults
        for part in place[:-1]:
            default = default.get(part, {}) if isinstance(default, Mapping) else {}
            if not isinstance(table.get(part), dict):
                table[part] = copy.deepcopy(default) if isinstance(default, dict) else {}
            table = table[part]
        self.forget(place)
        table[place[-1]] = toml_value(text)
        self.origins[place] = origin
        self.texts[place] = text


def toml_value(text: str) -> object:
    """A value as TOML reads it, else the text itself; ``True`` is meant as TOML's ``true``."""
    text = text.strip()
    if text.lower() in {"true", "false"}:
        return text.lower() == "true"
    if "\n" in text:
        return text
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text
    return value if _is_shallow(value) else text


def _is_shallow(value: object) -> bool:
    """Whether recursion over the value is harmless; ours has six levels at most."""
    level = [value]
    for _ in range(DEEPEST):
        items = [item.values() if isinstance(item, dict) else item for item in level]
        level = [one for item in items if not isinstance(item, str) for one in _inside(item)]
    return not level


def _inside(item: object) -> Iterable[object]:
    return item if isinstance(item, Iterable) else ()


def plain(text: str) -> str:
    """Text that stays on its line, whatever was typed."""
    return "".join(char if char.isprintable() else "?" for char in text)


def _split(override: str) -> tuple[str, str | None]:
    quote = ""
    for index, char in enumerate(override):
        if quote:
            quote = "" if char == quote else quote
        elif char in "\"'":
            quote = char
        elif char == "=":
            return override[:index], override[index + 1 :]
    return override, None


def _parts(name: str) -> Iterator[str]:
    # More lenient than TOML: shells eat the quotes of command.sources."cmd_vel/teleop".priority.
    at = 0
    while at < len(name):
        part = _KEY_PART.match(name, at)
        if part is None:
            yield ""
            return
        yield next(group for group in part.groups() if group is not None)
        at = part.end()
    if name.endswith("."):
        yield ""


def _why_unreadable(error: OSError) -> str:
    words = {
        FileNotFoundError: "no such file",
        IsADirectoryError: "a directory, where a file is expected",
        PermissionError: "this user may not read it",
    }
    return words.get(type(error), f"cannot be read: {error.strerror}")


def _syntax(name: str, message: str, text: str) -> tuple[Origin, str]:
    at = _SYNTAX.fullmatch(message)
    if at is None:
        return Origin(0, 0, name), f"not valid TOML: {message}"
    line = int(at["line"] or text.rstrip().count("\n") + 1)
    column = f", column {at['column']}" if at["column"] else ""
    why = at["why"][:1].lower() + at["why"][1:]
    # tomllib shows a key as Python does: ('chassis', 'motors').
    why = _TUPLE.sub(lambda found: ".".join(re.findall(r"'([^']*)'", found[0])), why)
    value = _BARE_TEXT.fullmatch(text.split("\n")[line - 1])
    if value is not None:
        why += f'; text needs quotes: "{value["text"].strip()}"'
    return Origin(0, line, f"{name}:{line}"), f"not valid TOML at line {line}{column}: {why}"
