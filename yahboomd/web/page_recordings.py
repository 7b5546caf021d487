"""Recording from a page, and the stored recordings: bounded, listed, deleted on request."""

from __future__ import annotations

import asyncio
import contextlib
import re
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from yahboomd.core.clock import Clock, seconds
from yahboomd.web.child_command import END_S, Child
from yahboomd.web.page_session import part

ONE_BYTES = 500_000_000
"""The newest part of a recording is kept: five hours of a robot at 50 Hz."""

ALL_BYTES = 4_000_000_000
"""The size of all recordings above which none begins."""

FREE_BYTES = 1_000_000_000
"""Disk space that recordings leave free."""

MOST = 200
"""The number of recordings at which none begins."""

LONGEST_S = 6 * 3600

ALONE_S = 60.0
"""A recording ends when no driver's page was open for this time."""

SHOWN_S = 1.0

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}")
FILE = re.compile(r"(native|ros2)_[0-9]{1,6}\.mcap|metadata\.yaml")

RUNNING = "A recording runs already."
GONE = "That recording does not exist any more."


class PageRecordings:
    """The recorder that pages start and stop, and its folder."""

    def __init__(
        self, clock: Clock, robot: Sequence[str], folder: Path, changed: Callable[[], None]
    ) -> None:
        self._clock = clock
        self._robot = tuple(robot)
        self._folder = folder
        self._changed = changed
        self._beginning = asyncio.Lock()
        self._task: asyncio.Task[None] | None = None
        self._stop = asyncio.Event()
        self._drivers = set[int]()
        self._alone = clock.alarm(self._stop.set)
        self._name = ""
        self._began_ns = 0
        self._bytes = 0
        self._ended = ""

    @property
    def running(self) -> bool:
        """Whether it records."""
        return self._task is not None

    def shown(self) -> bytes:
        """The recorder as pages show it."""
        running = self.running
        return part(
            "recording",
            name=self._name if running else None,
            for_s=round(seconds(self._clock.now_ns() - self._began_ns)) if running else None,
            bytes=self._bytes,
            ended=self._ended,
        )

    async def begin(self) -> str:
        """Start a recording; returns the reason if it is refused, else an empty text."""
        async with self._beginning:
            return await self._begin()

    async def _begin(self) -> str:
        if self.running:
            return RUNNING
        if refusal := await asyncio.to_thread(self._no_room):
            return refusal
        self._name = await asyncio.to_thread(self._free_name)
        self._began_ns, self._bytes, self._ended = self._clock.now_ns(), 0, ""
        self._stop.clear()
        command = [
            *("record", str(self._folder / self._name), "--attached", "--json"),
            *(f"--max-size={ONE_BYTES}", f"--for={LONGEST_S}", *self._robot),
        ]
        self._task = asyncio.create_task(self._record(command), name="web-recording")
        self._changed()
        return ""

    def stop(self) -> str:
        """End the recording; returns the reason if it is refused, else an empty text."""
        if self._task is None:
            return "No recording runs."
        self._stop.set()
        return ""

    async def _record(self, command: Sequence[str]) -> None:
        try:
            child = await Child.start(command)
        except OSError as error:
            self._task, self._ended = None, f"The recorder cannot be started: {error.strerror}."
            self._changed()
            return
        reading = asyncio.create_task(_last_line(child))
        stopped = asyncio.create_task(self._stop.wait())
        try:
            while not reading.done():
                self._bytes = await asyncio.to_thread(_size, self._folder / self._name)
                self._changed()
                await asyncio.wait(
                    {reading, stopped}, timeout=SHOWN_S, return_when=asyncio.FIRST_COMPLETED
                )
                if stopped.done():
                    child.close_input()
                    await asyncio.wait({reading}, timeout=END_S)
                    break
        finally:
            stopped.cancel()
            await asyncio.shield(child.end())
            self._task = None
        facts = await reading
        self._ended = _words(self._name, facts) if facts else child.last_words
        self._changed()

    def driver_came(self, page: int) -> None:
        """A page that may record was opened."""
        self._drivers.add(page)
        self._alone.set(None)

    def page_left(self, page: int) -> None:
        """A page was closed; after the last driver's, a recording ends soon."""
        self._drivers.discard(page)
        if not self._drivers and self._task is not None:
            self._alone.set(self._clock.now_ns() + int(ALONE_S * 1e9))

    async def close(self) -> None:
        """End the recording, and wait until its files are whole."""
        self._alone.close()
        task = self._task
        if task is not None:
            self._stop.set()
            await asyncio.wait([task])

    # Stored recordings.

    def _folders(self) -> list[Path]:
        try:
            found = list(self._folder.iterdir())
        except OSError:
            return []
        return [each for each in found if NAME.fullmatch(each.name) and _is_folder(each)]

    def _no_room(self) -> str:
        folders = self._folders()
        used = sum(map(_size, folders))
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o750)
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            return f"Recordings cannot be written to {self._folder}: {error.strerror}."
        if free < FREE_BYTES + ONE_BYTES:
            return f"Only {free / 1e9:.1f} GB of the disk are free. Delete recordings first."
        if used > ALL_BYTES - ONE_BYTES or len(folders) >= MOST:
            return (
                f"There are {len(folders)} recordings of {used / 1e9:.1f} GB together, and at most "
                f"{MOST} of {ALL_BYTES / 1e9:.0f} GB are kept. Delete some first."
            )
        return ""

    def _free_name(self) -> str:
        numbers = [
            int(found[1])
            for each in self._folders()
            if (found := re.fullmatch(r"run-([0-9]{1,9})", each.name))
        ]
        return f"run-{max(numbers, default=0) + 1:03}"

    def listed(self) -> dict[str, Any]:
        """The recordings, the newest first; reads the disk, so in a thread."""
        running = self._name if self._task is not None else None
        found = [
            each for folder in self._folders() if (each := _entry(folder, folder.name == running))
        ]
        found.sort(key=lambda each: each["at_s"], reverse=True)
        try:
            # The folder is made by the first recording.
            there = next(each for each in (self._folder, *self._folder.parents) if each.is_dir())
            free: int | None = shutil.disk_usage(there).free
        except OSError:
            free = None
        return {
            "recordings": found,
            "bytes": sum(each["bytes"] for each in found),
            "most_bytes": ALL_BYTES,
            "free_bytes": free,
        }

    def file(self, name: str, file: str) -> Path | None:
        """A file of a recording; None for all other names."""
        if not NAME.fullmatch(name) or not FILE.fullmatch(file):
            return None
        path = self._folder / name / file
        if not _is_folder(path.parent) or path.is_symlink() or not path.is_file():
            return None
        return path

    async def delete(self, name: object) -> str:
        """Remove a recording; returns the reason if it is refused, else an empty text."""
        if not isinstance(name, str) or not NAME.fullmatch(name):
            return GONE
        if self._task is not None and name == self._name:
            return "That recording still runs. End it first."
        return await asyncio.to_thread(_remove, self._folder / name)


async def _last_line(child: Child) -> dict[str, Any]:
    last: dict[str, Any] = {}
    async for line in child.lines():
        last = line
    return last


def _words(name: str, facts: dict[str, Any]) -> str:
    lost = facts.get("lost", 0)
    missing = "none lost" if not lost else f"{lost} lost"
    return f"{name} has {facts.get('messages', 0)} messages, {missing}."


def _is_folder(path: Path) -> bool:
    return path.is_dir() and not path.is_symlink()


def _files(folder: Path) -> list[tuple[str, int, float]]:
    found = []
    with contextlib.suppress(OSError):
        for each in sorted(folder.iterdir()):
            if FILE.fullmatch(each.name) and not each.is_symlink():
                with contextlib.suppress(OSError):
                    known = each.stat()
                    found.append((each.name, known.st_size, known.st_mtime))
    return found


def _size(folder: Path) -> int:
    return sum(size for _, size, _ in _files(folder))


def _entry(folder: Path, running: bool) -> dict[str, Any] | None:
    files = _files(folder)
    if not files and not running:
        # Not a recording.
        return None
    return {
        "name": folder.name,
        "running": running,
        "at_s": max((changed for *_, changed in files), default=0.0),
        "bytes": sum(size for _, size, _ in files),
        "files": [{"name": name, "bytes": size} for name, size, _ in files],
    }


def _remove(folder: Path) -> str:
    """Remove the files of a recording, and its folder if nothing else is in it."""
    if not _is_folder(folder) or not _files(folder):
        return GONE
    try:
        for name, *_ in _files(folder):
            (folder / name).unlink()
        with contextlib.suppress(OSError):
            folder.rmdir()
    except OSError as error:
        return f"{folder.name} cannot be removed: {error.strerror}."
    return ""
