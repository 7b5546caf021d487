"""Has the board started, or did it answer? Both may show its version in the same words.

Asked for its settings, such a board announces them and then says its version; one that starts says
the version alone. The first line of an answer may be lost on its way, so a version alone is a
banner only where no answer can be on its way: the caller knows when it asked.
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
        self._answering = isinstance(decoded, Reply) and decoded.settings_follow
        if not isinstance(decoded, VersionLine):
            return "none"
        if decoded.after_reset is not None:
            return "start" if decoded.after_reset else "none"
        return "none" if answering else "unclear"
