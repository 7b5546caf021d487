"""The sessions of phones: each phone has one of its own, which ends singly.

A session is a file in the state directory, with a hash of its cookie; the file's time is the last
use. Removing the file ends the session: the command line does it so, and the server notices within
a second. Requests are checked in memory, so that an emergency stop never waits for the disk.
"""

from __future__ import annotations

import asyncio
import hmac
import logging
import os
import secrets
import unicodedata
from collections import Counter, deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Literal, TypeAlias

import msgspec

from yahboomd.core.clock import Clock
from yahboomd.core.errors import ConfigError
from yahboomd.core.model import NS_PER_S
from yahboomd.web.session_files import (
    MINUTES,
    PREFIX,
    Role,
    StoredSession,
    claim,
    digest,
    end_stored,
    forget_links,
    link_of,
    read_stored,
    replace,
    since_boot_ns,
    touch,
)

log = logging.getLogger("yahboomd.web")

DAYS = 30
"""A session ends that was not used for this time."""

LIFE_NS = DAYS * 24 * 3600 * NS_PER_S

MOST = 100
"""The most sessions; a further one ends the one unused for longest."""

LOOK_S = 1.0
"""How often the files are looked at."""

TOUCH_NS = 600 * NS_PER_S
"""How often the time of a file in use is renewed."""

Refusal: TypeAlias = Literal["used", "old", "unknown", "tries", "ended", "viewer", "name", "disk"]

COUNTED: dict[Refusal, str] = {
    "used": "links that were used before",
    "old": f"links older than {MINUTES} minutes",
    "unknown": "links that the robot did not make, or has forgotten",
    "tries": "links after too many wrong ones",
    "ended": "requests of sessions that have ended",
    "viewer": "requests that only people who drive may make",
    "name": "names that are empty or taken",
    "disk": "links and names that could not be stored",
}
"""The meaning of each count."""

ENDED = "The session of this phone was ended."


class PhoneSession(msgspec.Struct, kw_only=True, eq=False):
    """A session that is valid.

    Attributes:
        used_ns: When it was used last, on the clock that counts from the boot.
        pages: The number of its open pages.
    """

    id: str
    role: Role
    name: str
    key: str
    made_s: int
    used_ns: int
    touched_ns: int
    pages: int = 0


class PhoneSessions:
    """The sessions of one server.

    Args:
        folder: The state directory.
        ended: Called with a session that ended, and why.
        renamed: Called when a phone got another name.
    """

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        ended: Callable[[PhoneSession, str], None],
        renamed: Callable[[], None],
    ) -> None:
        self._folder = folder
        self._clock = clock
        self._known: dict[str, PhoneSession] = {}
        self._over = set[str]()
        """Ended here: never valid again, even if a file could not be removed."""
        self._used: deque[str] = deque(maxlen=256)
        """Hashes of links that were used, to tell them from wrong ones."""
        self._files = asyncio.Lock()
        self._told = set[str]()
        self.refused: Counter[Refusal] = Counter()
        self._tell_end = ended
        self._tell_name = renamed

    @property
    def all(self) -> list[PhoneSession]:
        """The valid sessions; the one that was used last comes first."""
        return sorted(self._known.values(), key=lambda each: -each.used_ns)

    def refused_in_words(self) -> str:
        """Everything refused since the start, with its count."""
        return ", ".join(f"{COUNTED[why]}: {count}" for why, count in self.refused.items())

    def start(self) -> None:
        """Read the sessions; links that ended are removed.

        Raises:
            ConfigError: Other users could make sessions.
        """
        try:
            self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            mode = self._folder.stat().st_mode
        except OSError as error:
            raise ConfigError(
                f"The sessions of phones cannot be kept in {self._folder}: {error.strerror}.",
                remedy="Set XDG_STATE_HOME to a folder that this user may write to.",
            ) from error
        if mode & 0o022:
            raise ConfigError(
                f"Other users may write to {self._folder}: they could let themselves in.",
                remedy=f"`chmod go-w {self._folder}`",
            )
        forget_links(self._folder, self.now_ns())
        self._merge(self._scan(self._clock.wall_ns()))

    def now_ns(self) -> int:
        """The time on the clock that counts from the boot."""
        return since_boot_ns(self._clock)

    def of_cookie(self, cookie: str) -> PhoneSession | None:
        """The session of a cookie, compared in constant time; None for any other text."""
        number, _, key = cookie.partition(".")
        session, now_ns = self._known.get(number), self.now_ns()
        if session is None or not hmac.compare_digest(session.key, digest(key)):
            return None
        if now_ns - session.used_ns > LIFE_NS:
            return None
        session.used_ns = now_ns
        return session

    async def enter(
        self, token: str, name: str, former: PhoneSession | None
    ) -> tuple[PhoneSession, str] | Refusal:
        """Let a phone in; returns its session and cookie, or the reason why not.

        Args:
            name: The kind of device.
            former: A session that this browser has: its cookie is replaced, and it ends.
        """
        hashed = digest(token)
        now_ns = self.now_ns()
        async with self._files:
            link = await asyncio.to_thread(link_of, self._folder, token, now_ns)
            if isinstance(link, str):
                found: Refusal = "used" if hashed in self._used else link
                self.refused[found] += 1
                return found
            others = [each.name for each in self._known.values() if each is not former]
            name = former.name if former is not None else free_name(name, others)
            number, key = self._new_id(), secrets.token_urlsafe(16)
            made_s = self._clock.wall_ns() // NS_PER_S
            stored = StoredSession(role=link.role, name=name, key=digest(key), made_s=made_s)
            try:
                won = await asyncio.to_thread(
                    claim, self._folder, token, number, stored, self._clock.wall_ns()
                )
            except OSError as error:
                self._tell(f"A phone could not be let in: {error.strerror}.")
                self.refused["disk"] += 1
                return "disk"
            self._used.append(hashed)
            if not won:
                self.refused["used"] += 1
                return "used"
            session = PhoneSession(
                id=number,
                role=link.role,
                name=name,
                key=stored.key,
                made_s=made_s,
                used_ns=now_ns,
                touched_ns=now_ns,
            )
            self._known[number] = session
        if former is not None:
            await self.end(former, "This phone was let in again by another link.")
        while len(self._known) > MOST and (oldest := self._longest_unused(session)) is not None:
            await self.end(oldest, f"More than {MOST} phones were let in.")
        return session, f"{number}.{key}"

    async def end(self, session: PhoneSession, words: str = ENDED) -> str:
        """End a session, at once; returns what went wrong, or empty."""
        self._drop(session, words)
        async with self._files:
            try:
                await asyncio.to_thread(end_stored, self._folder, session.id)
            except OSError as error:
                words = f"Its file cannot be removed ({error.strerror}): after a restart of the "
                words += "server the session would be valid again."
                self._tell(f"Session {session.id}: {words}")
                return words
        return ""

    async def rename(self, session: PhoneSession, text: str) -> str:
        """Give a phone a name; returns the reason if that is refused, or empty."""
        name = clean_name(text)
        others = [each.name for each in self._known.values() if each is not session]
        if not name or is_taken(name, others):
            self.refused["name"] += 1
            return "Another phone has this name." if name else "A name needs letters or digits."
        stored = StoredSession(role=session.role, name=name, key=session.key, made_s=session.made_s)
        async with self._files:
            try:
                await asyncio.to_thread(replace, self._folder, session.id, stored)
            except OSError as error:
                self._tell(f"A name could not be stored: {error.strerror}.")
                self.refused["disk"] += 1
                return f"The name cannot be stored on the robot: {error.strerror}."
        session.name = name
        self._tell_name()
        return ""

    async def run(self) -> None:
        """Look for sessions that were ended, or are unused for too long, until cancelled."""
        while True:
            await asyncio.sleep(LOOK_S)
            try:
                await self.look()
            except RuntimeError as error:
                # No thread is left: the next look comes in a second.
                self._tell(f"The sessions cannot be looked at: {error}.")

    async def look(self) -> None:
        """Look once."""
        now_ns = self.now_ns()
        for session in self.all:
            if session.pages:
                session.used_ns = now_ns
            if now_ns - session.used_ns > LIFE_NS:
                await self.end(session, f"This phone was not used for {DAYS} days.")
        async with self._files:
            self._merge(await asyncio.to_thread(self._scan, self._clock.wall_ns()))

    # Files; in a thread, one at a time.

    def _scan(self, wall_ns: int) -> dict[str, tuple[StoredSession, int] | None] | None:
        """The sessions by their files, unread if they are known; None if the disk fails."""
        found: dict[str, tuple[StoredSession, int] | None] = {}
        try:
            names = os.listdir(self._folder)
        except FileNotFoundError:
            return found
        except OSError as error:
            self._tell(f"The sessions in {self._folder} cannot be read: {error.strerror}.")
            return None
        for name in sorted(names):
            if not name.startswith(PREFIX):
                continue
            number = name.removeprefix(PREFIX)
            session = self._known.get(number)
            if session is not None:
                found[number] = None
                if session.used_ns - session.touched_ns > TOUCH_NS:
                    session.touched_ns = session.used_ns
                    touch(self._folder / name, wall_ns)
            elif number not in self._over and len(found) < 2 * MOST:
                path = self._folder / name
                if (stored := read_stored(path)) is not None:
                    found[number] = stored
                else:
                    self._tell(f"{path} is no session, or other users can read it: it is ignored.")
        return found

    # In memory.

    def _merge(self, files: dict[str, tuple[StoredSession, int] | None] | None) -> None:
        if files is None:
            # The disk fails: nobody loses a session for that.
            return
        for session in self.all:
            if session.id not in files:
                self._drop(session, ENDED)
        now_ns, wall_ns = self.now_ns(), self._clock.wall_ns()
        for number, found in files.items():
            if found is not None and number not in self._known:
                stored, used_ns = found
                # A time in the future is one of a clock that was wrong.
                idle_ns = max(0, wall_ns - used_ns)
                self._known[number] = PhoneSession(
                    id=number,
                    role=stored.role,
                    name=clean_name(stored.name) or number,
                    key=stored.key,
                    made_s=stored.made_s,
                    used_ns=now_ns - idle_ns,
                    touched_ns=now_ns - idle_ns,
                )

    def _drop(self, session: PhoneSession, words: str) -> None:
        self._over.add(session.id)
        if self._known.pop(session.id, None) is not None:
            self._tell_end(session, words)

    def _longest_unused(self, newest: PhoneSession) -> PhoneSession | None:
        free = [each for each in self.all if not each.pages and each is not newest]
        return free[-1] if free else None

    def _new_id(self) -> str:
        while (number := secrets.token_hex(3)) in self._known or number in self._over:
            pass
        return number

    def _tell(self, words: str) -> None:
        """Log it once."""
        if words not in self._told and len(self._told) < MOST:
            self._told.add(words)
            log.warning("%s", words)


LONGEST = 32

RESERVED = {"this page", "another page", "no page", "nobody", "the page", "all"}
"""Words that the page or a command uses itself."""

KINDS = (
    ("iphone", "iPhone"),
    ("ipad", "iPad"),
    ("android", "Android phone"),
    ("windows", "Windows computer"),
    ("macintosh", "Mac"),
    ("linux", "Linux computer"),
)


UNSEEN = frozenset("\u034f\u115f\u1160\u17b4\u17b5\u180b\u180c\u180d\u180f\u2800\u3164\uffa0") | {
    chr(code) for each in ((0xFE00, 0xFE10), (0xE0100, 0xE01F0)) for code in range(*each)
}
"""Letters and marks that show nothing: with them two names could look the same."""


def device(user_agent: str) -> str:
    """The kind of device, by the header that browsers send."""
    text = user_agent.lower()
    return next((words for mark, words in KINDS if mark in text), "A browser")


def clean_name(text: str) -> str:
    """A name without control characters, marks of direction, unseen ones and superfluous blanks."""
    seen = (c for c in text[: 4 * LONGEST] if c not in UNSEEN)
    kept = (c if unicodedata.category(c)[0] in "LMNPSZ" else " " for c in seen)
    return " ".join("".join(kept).split())[:LONGEST].strip()


def is_taken(name: str, others: Iterable[str]) -> bool:
    """Whether people could take it for another one's."""
    same = unicodedata.normalize("NFKC", name).casefold()
    taken = {unicodedata.normalize("NFKC", other).casefold() for other in others}
    return same in taken | RESERVED


def free_name(name: str, others: Iterable[str]) -> str:
    """The name, with a number if another phone has it."""
    others = list(others)
    number = 1
    found = name
    while is_taken(found, others):
        number += 1
        found = f"{name} {number}"
    return found
