"""Brings the configuration file of an older version up to this one, and keeps a person's lines.

An older default file was a copy of every default, so that it also fixed those that have changed
since. Lines are left out or added; none is written anew.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Mapping
from difflib import unified_diff
from pathlib import Path
from typing import NamedTuple

from yahboomd.core.config import Config, read
from yahboomd.core.config.layers import LARGEST_FILE_BYTES
from yahboomd.core.config.reading import read_named
from yahboomd.core.config.values import dotted, inline
from yahboomd.core.errors import ConfigError
from yahboomd.tools.schemas.reference import default_toml
from yahboomd.tools.whole_file import write_whole

SOURCES = ("command", "sources")
FIRST_SOURCES = {"cmd_vel", "cmd_vel/teleop"}
"""The sources of the oldest default file: a table without them is a person's own choice."""

WHOLE = (SOURCES, ("chassis", "motors"))
"""Tables that replace the default one as a whole."""

BEFORE = ".before-migrate"
"""The end of the old file's new name."""

HEAD = """\
# Only what differs from the defaults. `yahboomd config reference` explains every key.
"""

_KNOWN_SHARE = 0.6
"""A comment with this share of the reference's own words is one of the reference."""


class Migration(NamedTuple):
    """A change of a configuration file.

    Attributes:
        before: The file's text.
        after: The same, if nothing has to change.
        sentences: One for each change.
    """

    before: str
    after: str
    sentences: tuple[str, ...] = ()

    def diff(self, path: Path) -> str:
        """The changes by line."""
        lines = unified_diff(
            self.before.splitlines(), self.after.splitlines(), str(path), "migrated", "", "", 1, ""
        )
        return "\n".join(lines)


def migration(path: Path) -> Migration:
    """Find what a file lacks, and which of its lines only repeat a default.

    Raises:
        ConfigError: The file cannot be read or used; `yahboomd config check` names the mistakes.
    """
    read(path, environ={})
    try:
        before = read_named(path, LARGEST_FILE_BYTES).decode("utf-8-sig").replace("\r\n", "\n")
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}.") from error
    added, sentences = _with_sources(before)
    shorter, gone = _without_defaults(added)
    # The robot must be the same one, but for the sources.
    if gone and Config.of(tomllib.loads(shorter)) == Config.of(tomllib.loads(added)):
        sentences.append(
            f"{gone} keys repeat their defaults, and are left out: they follow each version's."
        )
        added = shorter
    return Migration(before, added if sentences else before, tuple(sentences))


def write_migrated(path: Path, found: Migration) -> Path:
    """Write the file, with its mode and owner; returns the copy of the old one.

    Raises:
        ConfigError: It cannot be written: it is as it was.
    """
    before = path.with_name(f"{path.name}{BEFORE}")
    try:
        # A link stays one, and leads to the new file.
        path = path.resolve()
        status = path.stat()
        mode = status.st_mode & 0o7777
        owner = (status.st_uid, status.st_gid) if os.geteuid() == 0 else None
        write_whole(before, found.before.encode(), mode=mode, owner=owner)
        write_whole(path, found.after.encode(), mode=mode, owner=owner)
    except OSError as error:
        raise ConfigError(
            f"{path} cannot be written: {error.strerror}.",
            remedy="Run the same command with sudo.",
        ) from error
    return before


def _with_sources(text: str) -> tuple[str, list[str]]:
    given = tomllib.loads(text).get("command", {}).get("sources", {})
    missing = {
        name: source
        for name, source in Config().as_data()["command"]["sources"].items()
        if name not in given
    }
    if not given or not missing or FIRST_SOURCES - set(given):
        return text, []
    added = "".join(
        f"\n[{dotted((*SOURCES, name))}]\n"
        + "".join(f"{key} = {inline(value)}\n" for key, value in source.items())
        for name, source in missing.items()
    )
    longer = f"{text.rstrip()}\n{added}"
    try:
        tomllib.loads(longer)
    except tomllib.TOMLDecodeError:
        # The sources are one value in braces, to which no table can be added.
        names = ", ".join(missing)
        raise ConfigError(
            f"command.sources lacks {names}, and is written as one value in braces.",
            remedy="Write each source with a header of its own: [command.sources.cmd_vel].",
        ) from None
    users = {"cmd_vel/web": "the page", "cmd_vel/moves": "yahboomd move"}
    return longer, [
        f"command.sources lacks {name}: {users.get(name, 'it')} cannot drive. It is added."
        for name in missing
    ]


class _Item(NamedTuple):
    """Lines of a file: a block of comments, a blank line, a header, or a key with its value.

    Attributes:
        kind: ``comment``, ``blank``, ``header`` or ``key``.
        place: The table or key; of comments, the one that they stand before or show.
    """

    kind: str
    lines: tuple[str, ...]
    place: tuple[str, ...] = ()
    value: object = None


def _items(text: str) -> list[_Item]:
    """The file in blocks, each comment with the place that it explains."""
    found: list[_Item] = []
    table: tuple[str, ...] = ()
    comments: list[str] = []
    waiting: list[str] = []
    for line in [*text.splitlines(), ""]:
        if not waiting and line.lstrip().startswith("#"):
            comments.append(line)
            continue
        waiting.append(line)
        try:
            data = tomllib.loads("\n".join(waiting))
        except tomllib.TOMLDecodeError:
            # A value of several lines.
            continue
        if not line.strip() and len(waiting) == 1:
            item = _Item("blank", ("",))
            place = _shown(comments, table)
        elif waiting[0].lstrip().startswith("["):
            table = place = _table(data)
            item = _Item("header", tuple(waiting), table)
        else:
            key = _key(waiting[0])
            place = (*table, *key)
            item = _Item("key", tuple(waiting), place, _at(data, key))
        if comments:
            found.append(_Item("comment", tuple(comments), place))
        found.append(item)
        comments, waiting = [], []
    return found


def _table(data: object) -> tuple[str, ...]:
    place: tuple[str, ...] = ()
    while isinstance(data, dict) and data:
        ((key, data),) = data.items()
        place = (*place, key)
    return place


def _key(line: str) -> tuple[str, ...]:
    """The parts of the key of a line, which may contain an equals sign in quotes."""
    for sign in re.finditer("=", line):
        try:
            return _table(tomllib.loads(f"{line[: sign.start()]}= 0"))
        except tomllib.TOMLDecodeError:
            continue
    return ()


def _shown(comments: list[str], table: tuple[str, ...]) -> tuple[str, ...]:
    """The optional key that a block of comments shows in its last line; empty for none."""
    shown = re.match(r"# (\w+) = ", comments[-1]) if comments else None
    return (*table, shown[1]) if shown else ()


def _at(data: object, place: tuple[str, ...]) -> object:
    for part in place:
        data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value


def _without_defaults(text: str) -> tuple[str, int]:
    """A copy of the default file without the keys that repeat a default, and their number."""
    defaults, data = Config().as_data(), tomllib.loads(text)
    same = {table: _plain(_at(data, table)) == _plain(_at(defaults, table)) for table in WHOLE}
    if _at(data, ("chassis", "preset")):
        # A preset's motors are changed one by one.
        same["chassis", "motors"] = False
    items = _items(text)

    def repeats(item: _Item) -> bool:
        whole = next((table for table in WHOLE if item.place[: len(table)] == table), None)
        if whole is not None:
            return same[whole]
        default = _at(defaults, item.place)
        return default is not None and _plain(default) == _plain(item.value)

    reference = _items(default_toml())
    gone = {n for n, item in enumerate(items) if item.kind == "key" and repeats(item)}
    # Otherwise a person wrote it, and may mean each line.
    if 2 * len(gone) < sum(item.kind == "key" for item in reference):
        return text, 0
    about = {item.place: _words(item.lines) for item in reference if item.kind == "comment"}
    lines: list[str] = []
    header: list[str] = []
    for n, item in enumerate(items):
        if item.kind == "header":
            # Only with something below it.
            header = list(item.lines)
        elif item.kind == "comment":
            known = about.get(item.place, set())
            kept_key = n + 1 < len(items) and items[n + 1].kind == "key" and n + 1 not in gone
            own = item.lines if kept_key else _of_a_person(item.lines, known)
            lines += [*header, *own] if own and items[n + 1].kind != "header" else own
            header = [] if own and items[n + 1].kind != "header" else header
        elif item.kind == "blank":
            lines += [""] if lines and lines[-1] else []
        elif n not in gone:
            lines += [*header, *item.lines]
            header = []
    return HEAD + "\n" + "\n".join(lines).strip() + "\n", len(gone)


def _words(lines: tuple[str, ...]) -> set[str]:
    return set(re.findall(r"[a-z_]{2,}", " ".join(lines).lower()))


def _of_a_person(lines: tuple[str, ...], known: set[str]) -> list[str]:
    """The lines of a comment that the reference, in this version or another, does not have."""
    own = []
    for line in lines:
        words = _words((line,))
        if len(words & known) < _KNOWN_SHARE * len(words):
            own.append(line)
    return own
