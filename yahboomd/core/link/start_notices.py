"""Distinguishes a board that starts from one that answers: both may send the same version line.

Asked for its settings, such a board announces them and then sends its version; one that starts
sends the version alone. The first line of an answer may be lost on its way, so a version alone is a
banner if no answer can be on its way, and unclear while one can.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

from yahboomd.core.protocol.dialect import Decoded, Reply, VersionLine

Notice: TypeAlias = Literal["none", "start", "unclear"]

LATEST_ANSWER_NS = 1_200_000_000
"""The longest that any part of an answer comes after the question for the settings."""


class StartNotices:
    """Distinguishes the banner of a board that starts from the version among its settings."""

    def __init__(self) -> None:
        self._answering = False
        self._answer_until_ns = 0

    def asked(self, now_ns: int) -> None:
        """Note that a question was sent that a version may answer."""
        self._answer_until_ns = now_ns + LATEST_ANSWER_NS

    def judge(self, decoded: Decoded, now_ns: int) -> Notice:
        """Recognise a start by a line. Pass every line, in order; counts may be left out.

        Returns:
            ``unclear`` for a banner, or an answer that lost its first line. Then all earlier
            knowledge of the board is in doubt; but a banner that is taken for an answer is not
            missed: the stream that it ended is armed again after a silence, and the counters show
            where they started from.
        """
        answering = self._answering
        self._answering = isinstance(decoded, Reply) and decoded.settings_follow
        if not isinstance(decoded, VersionLine):
            return "none"
        if decoded.after_reset is not None:
            return "start" if decoded.after_reset else "none"
        if answering:
            return "none"
        return "unclear" if now_ns <= self._answer_until_ns else "start"
