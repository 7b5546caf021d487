"""A disk that loses power: a program's writes are recorded, and any part of them is replayed.

The model is worse than a disk with a journal: the content of a file that was not synced is there in
part, in any order, a missing part as zeros; names change in their order, and those that were not
synced may be missing from some point on.
"""

from __future__ import annotations

import random
import re
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

CALLS = (
    "openat,write,pwrite64,writev,pwritev,lseek,ftruncate,fsync,fdatasync,close,dup,dup2,"
    "rename,renameat,renameat2,link,linkat,unlink,unlinkat,mkdir,mkdirat,copy_file_range,sendfile"
)
MARK = "/yahboomd-step"
"""A file that is not there, opened to mark a step in the record."""

_LINE = re.compile(r"^(?:\d+ +)?(\w+)\((.*)\) += (-?\d+)")
_TEXT = re.compile(r'"((?:\\x[0-9a-f]{2})*)"')


def record(program: Path, folder: Path) -> list[str]:
    """The calls of a program that gets the folder as its argument."""
    log = folder.with_name(f"{folder.name}.calls")
    subprocess.run(
        ["strace", "-f", "-q", "-xx", "-s", "10000000", "-e", f"trace={CALLS}", "-e", "signal=none",
         "-o", str(log), sys.executable, str(program), str(folder)],
        check=True,
    )  # fmt: skip
    return log.read_text().splitlines()


@dataclass
class _File:
    """A file's content: the synced one, and the later changes, each ``(at, bytes)`` or a length."""

    synced: bytes = b""
    later: list[tuple[int, bytes] | int] = field(default_factory=list)


class Write(NamedTuple):
    file: int
    at: int
    data: bytes


class Cut(NamedTuple):
    file: int
    size: int


class SyncFile(NamedTuple):
    file: int


class SyncFolder(NamedTuple):
    folder: str


class Named(NamedTuple):
    """A change of names: each path and the file that it leads to from now on, or None."""

    changes: tuple[tuple[str, int | None], ...]


class Step(NamedTuple):
    """A step has returned."""


Change = Write | Cut | SyncFile | SyncFolder | Named | Step


def changes_below(folder: Path, calls: list[str]) -> list[Change]:
    """The changes below a folder, and the steps that were marked with its name, in their order."""
    found: list[Change] = []
    root = f"{folder}/"
    names: dict[str, int] = {}
    opened: dict[int, tuple[int | str, int]] = {}
    sizes: dict[int, int] = {}

    def inside(path: str) -> bool:
        return path.startswith(root)

    for line in calls:
        if (match := _LINE.match(line)) is None:
            continue
        call, arguments, result = match[1], match[2], int(match[3])
        texts = [bytes.fromhex(text.replace("\\x", "")) for text in _TEXT.findall(arguments)]
        first = arguments.split(",", 1)[0]
        fd = int(first) if first.isdigit() else -1
        if call == "openat":
            path = texts[0].decode()
            if path == f"{MARK}-{folder.name}":
                found.append(Step())
            elif result >= 0:
                opened.pop(result, None)
                if path == str(folder) or "O_DIRECTORY" in arguments:
                    opened[result] = (path, 0)
                elif inside(path):
                    if path not in names:
                        names[path] = len(sizes)
                        sizes[names[path]] = 0
                        found.append(Named(((path, names[path]),)))
                    number = names[path]
                    if "O_TRUNC" in arguments and sizes[number]:
                        sizes[number] = 0
                        found.append(Cut(number, 0))
                    opened[result] = (number, sizes[number] if "O_APPEND" in arguments else 0)
        elif result < 0:
            continue
        elif call == "close":
            opened.pop(fd, None)
        elif call in {"rename", "renameat", "renameat2"}:
            old, new = texts[0].decode(), texts[1].decode()
            if inside(new):
                number = names.pop(old)
                names[new] = number
                found.append(Named(((old, None), (new, number))))
        elif call in {"link", "linkat"}:
            old, new = texts[0].decode(), texts[1].decode()
            if inside(new):
                names[new] = names[old]
                found.append(Named(((new, names[old]),)))
        elif call in {"unlink", "unlinkat"}:
            path = texts[0].decode()
            if inside(path) and path in names:
                del names[path]
                found.append(Named(((path, None),)))
        elif fd in opened:
            target, at = opened[fd]
            if call in {"fsync", "fdatasync"}:
                found.append(SyncFolder(target) if isinstance(target, str) else SyncFile(target))
            elif isinstance(target, str):
                continue
            elif call == "write":
                found.append(Write(target, at, texts[0][:result]))
                opened[fd] = (target, at + result)
                sizes[target] = max(sizes[target], at + result)
            elif call == "lseek":
                opened[fd] = (target, result)
            elif call == "ftruncate":
                sizes[target] = int(arguments.split(",")[1])
                found.append(Cut(target, sizes[target]))
            else:
                raise NotImplementedError(line)
    return found


def after_a_cut(changes: list[Change], chance: random.Random) -> dict[str, bytes]:
    """The files, by path, that are left after these changes and a power cut.

    Args:
        changes: All until the cut.
        chance: Which unsynced ones are on the disk.
    """
    files: dict[int, _File] = {}
    names: dict[str, int] = {}
    waiting: list[Named] = []
    for change in changes:
        match change:
            case Write(number, at, data):
                files.setdefault(number, _File()).later.append((at, data))
            case Cut(number, size):
                files.setdefault(number, _File()).later.append(size)
            case SyncFile(number):
                file = files.setdefault(number, _File())
                file.synced, file.later = _content(file, lambda: 1.0), []
            case Named():
                waiting.append(change)
            case SyncFolder(folder):
                # A name in another folder waits on.
                done = [each for each in waiting if _touches(each, folder)]
                waiting = [each for each in waiting if not _touches(each, folder)]
                _name(names, done)
            case Step():
                pass
    _name(names, waiting[: chance.randint(0, len(waiting))])
    lost = chance.random() < 0.3

    def share() -> float:
        return 0.0 if lost else chance.choice((0.0, 1.0, chance.random()))

    return {
        path: _content(files.get(number, _File()), share) for path, number in sorted(names.items())
    }


def whole(changes: list[Change]) -> dict[str, bytes]:
    """The files without a cut."""
    folders = {
        path.rpartition("/")[0]
        for change in changes
        if isinstance(change, Named)
        for path, _ in change.changes
    }
    numbers = {change.file for change in changes if isinstance(change, Write | Cut)}
    ends: list[Change] = [*map(SyncFile, numbers), *map(SyncFolder, folders)]
    return after_a_cut([*changes, *ends], random.Random(0))


def _touches(change: Named, folder: str) -> bool:
    return any(path.rpartition("/")[0] == folder for path, _ in change.changes)


def _name(names: dict[str, int], changes: list[Named]) -> None:
    for change in changes:
        for path, number in change.changes:
            if number is None:
                names.pop(path, None)
            else:
                names[path] = number


def _content(file: _File, share) -> bytes:
    content = bytearray(file.synced)
    for change in file.later:
        if isinstance(change, int):
            if share() > 0.5:
                del content[change:]
            continue
        at, data = change
        part = share()
        if part == 0.0:
            # Its length may be on the disk, and not its bytes.
            if share() == 1.0:
                content.extend(b"\0" * (at + len(data) - len(content)))
            continue
        kept = data[: max(1, round(part * len(data)))]
        content.extend(b"\0" * (at + len(kept) - len(content)))
        content[at : at + len(kept)] = kept
    return bytes(content)
