"""The dialects by name, and what can be said to a board before its dialect is known."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from yahboomd.protocol.dialect import Dialect
from yahboomd.protocol.framing import Frame, TextLine
from yahboomd.protocol.polled import Polled
from yahboomd.protocol.streamed import Streamed

DIALECTS: Final[dict[str, Dialect]] = {dialect.name: dialect for dialect in (Streamed(), Polled())}
"""Every dialect, in the order in which a board is asked."""

CONNECT_STOP: Final[tuple[bytes, ...]] = tuple(
    dialect.cut or dialect.brake for dialect in DIALECTS.values()
)
"""The surest stop of each dialect: after a crash the wheels may still turn, whichever board it
is. Behind :data:`~yahboomd.protocol.framing.RESYNC`, :data:`CONNECT_SPACING_NS` apart."""

CONNECT_SPACING_NS: Final = max(dialect.spacing_ns for dialect in DIALECTS.values())
"""The gap that no dialect minds."""


def identify(items: Iterable[Frame | TextLine]) -> str | None:
    """Say which dialect a board speaks, from what it has sent.

    Any answer in words means ``streamed``, a complaint about an unknown command too; so does a
    stream that is still running. Counters that were asked for mean ``polled``. What has no meaning
    in any dialect, such as the chatter of another device or half a frame, means nothing.

    Args:
        items: All that came in since the first question.

    Returns:
        A name in :data:`DIALECTS`, or None.
    """
    seen = list(items)
    for name, dialect in DIALECTS.items():
        if any(dialect.recognises(item) for item in seen):
            return name
    return None
