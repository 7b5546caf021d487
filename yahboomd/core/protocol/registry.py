"""The dialects by name, and the frames for a board whose dialect is not known yet."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from yahboomd.core.protocol.dialect import Dialect, Item
from yahboomd.core.protocol.four_channel.polled import Polled
from yahboomd.core.protocol.four_channel.streamed import Streamed
from yahboomd.core.protocol.rosmaster.rosmaster import Rosmaster
from yahboomd.core.protocol.settings import BoardSettings
from yahboomd.core.protocol.settings import check_storable as check

DIALECTS: Final[dict[str, Dialect]] = {
    dialect.name: dialect for dialect in (Streamed(), Polled(), Rosmaster())
}
"""Every dialect, in the order in which a board is stopped and asked."""


def connect_stop() -> tuple[tuple[bytes, bytes], ...]:
    """For each dialect its resync and its surest stop, to be sent one after the other on any port.

    After a crash the wheels may still turn, on any board. They are :func:`connect_spacing_ns`
    apart. A resync is omitted if the dialect before has the same.
    """
    words = []
    before = b""
    for dialect in DIALECTS.values():
        resync = b"" if dialect.resync == before else dialect.resync
        before = dialect.resync
        words.append((resync, dialect.surest_stop))
    return tuple(words)


def connect_spacing_ns() -> int:
    return max(dialect.spacing_ns for dialect in DIALECTS.values())


def usb_ids() -> tuple[str, ...]:
    return tuple(dict.fromkeys(usb for each in DIALECTS.values() for usb in each.usb_ids))


def identify(heard: Iterable[tuple[str, Item]]) -> str | None:
    """Identify the dialect of a board by the items that it sent.

    Items without a meaning in any dialect, such as the chatter of another device or half a frame,
    do not count.

    Args:
        heard: All items since the first question, with the name of the dialect whose framer found
            each.

    Returns:
        A name in :data:`DIALECTS`, or None.
    """
    seen = list(heard)
    for name, dialect in DIALECTS.items():
        if any(dialect.recognises(item) for found_by, item in seen if found_by == name):
            return name
    return None


def unknown_dialect(heard: bytes) -> str:
    """A sentence about a board that answers our commands as some clones do; empty for others."""
    if (answer := re.search(rb"\w+\+OK", heard)) is None:
        return ""
    return (
        f"The board answers {answer[0].decode()!r}: it speaks a dialect that yahboomd does not "
        "know. Some compatible boards do, with whose firmware yahboomd cannot drive."
    )


def check_storable(want: BoardSettings) -> None:
    """Refuse values that some board would accept and then run away with.

    Raises:
        ConfigError: Naming every such value.
    """
    for dialect in DIALECTS.values():
        check(dialect.settings, want)
