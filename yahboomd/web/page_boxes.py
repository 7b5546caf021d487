"""The black boxes of this machine for pages: listed, explained in words, downloaded, saved.

`yahboomd blackbox` does all of it, in a process of its own: one at a time.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException

from yahboomd.core.clock import Clock
from yahboomd.web.child_command import output_of

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,79}")

KNOWN_NS = 2_000_000_000
"""A list that is younger than this is shown again."""

WAITING = 8
"""The number of requests that may wait; more are refused."""

BUSY = "Too many people ask at once. This page asks again."


class PageBoxes:
    """The boxes of this machine."""

    def __init__(self, clock: Clock, robot: Sequence[str]) -> None:
        self._clock = clock
        self._robot = tuple(robot)
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._boxes: list[dict[str, Any]] = []
        self._problem = ""
        self._listed_ns: int | None = None

    async def listed(self) -> dict[str, Any]:
        """The boxes, the newest first, and the problem in words if they cannot be listed."""
        await self._list()
        shown = [
            {
                "name": _name(each),
                "kind": each["kind"],
                "reason": _reason(each),
                "at_s": each["written_ns"] / 1e9,
                "bytes": each["bytes"],
            }
            for each in reversed(self._boxes)
        ]
        return {"boxes": shown, "problem": self._problem}

    async def explained(self, name: str) -> dict[str, Any] | None:
        """Why the robot stopped, and the events before; None if there is no such box."""
        box = await self._box(name)
        if box is None:
            return None
        # By its file, as listed: the services of a machine each number their boxes from 1.
        status, printed, words = await self._ask(["explain", box["path"], "--json"])
        try:
            facts = json.loads(printed) if status == 0 else {}
        except ValueError:
            facts = {}
        why = facts.get("why") or words or "It cannot be read."
        lines = [
            {"before_s": each["before_s"], "what": each["what"], "words": each["words"]}
            for each in facts.get("lines", ())
        ]
        return {"why": why, "lines": lines}

    async def file(self, name: str) -> Path | None:
        """The file of a saved box; None for every other name."""
        box = await self._box(name)
        return Path(box["path"]) if box and box["kind"] == "saved" else None

    async def save(self) -> tuple[bool, str]:
        """Make the daemon save its box. Returns whether it was done, and a sentence for people."""
        self._listed_ns = None
        status, printed, words = await output_of(["blackbox", "save", *self._robot])
        return status == 0, (printed or words).strip()

    async def _box(self, name: str) -> dict[str, Any] | None:
        if not NAME.fullmatch(name):
            return None
        await self._list()
        return next((each for each in self._boxes if _name(each) == name), None)

    async def _list(self) -> None:
        now_ns = self._clock.now_ns()
        if self._listed_ns is not None and now_ns - self._listed_ns < KNOWN_NS:
            return
        status, printed, words = await self._ask(["list", "--json"])
        try:
            found = json.loads(printed) if status == 0 else {}
        except ValueError:
            found = {}
        self._boxes = found.get("boxes", [])
        denied = ", ".join(found.get("denied", ()))
        self._problem = f"{denied} cannot be read by this page's server." if denied else ""
        if status:
            self._problem = words or "The black boxes cannot be listed."
        # What was saved while it was made may be missing.
        self._listed_ns = now_ns

    async def _ask(self, arguments: Sequence[str]) -> tuple[int, str, str]:
        if self._waiting >= WAITING:
            raise HTTPException(503, BUSY)
        self._waiting += 1
        try:
            async with self._turn:
                # If the machine has several robots, only those of the page's robot.
                return await output_of(["blackbox", *arguments, *self._robot])
        finally:
            self._waiting -= 1


def _name(box: dict[str, Any]) -> str:
    return Path(box["path"]).stem


def _reason(box: dict[str, Any]) -> str:
    """The word in the name of a saved box's file."""
    stem = Path(box["path"]).stem if box["kind"] == "saved" else ""
    return stem.rpartition("Z_")[2].partition(".")[0]
