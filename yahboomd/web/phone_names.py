"""Names of phones: the one that a person gives, or else the kind of device."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable

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
