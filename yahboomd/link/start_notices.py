"""Has the board started, or did it answer? Both show its version in a line of the same words.

Asked for its settings, a board says ``read_flash:OK!`` and then its version; one that starts says
the version alone, or behind ``Reset MCU``. The first line of an answer may be lost on its way, so a
version alone is a banner only where no answer can be on its way: the caller knows when it asked.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

from yahboomd.protocol.dialect import Decoded, Reply, VersionLine

Notice: TypeAlias = Literal["none", "start", "unclear"]


class StartNotices:
    """Tells the banner of a board that starts from the version among its settings."""

    def __init__(self) -> None:
        self._answering = False

    def judge(self, decoded: Decoded) -> Notice:
        """What a line says of a start. Hand over every line, in order; counts may be left out.

        Returns:
            ``unclear`` for a version alone: a banner, or an answer that lost its first line.
        """
        answering = self._answering
        self._answering = isinstance(decoded, Reply) and decoded.command == "read_flash"
        if not isinstance(decoded, VersionLine):
            return "none"
        if decoded.after_reset:
            return "start"
        return "none" if answering else "unclear"
