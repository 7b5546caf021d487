"""Finds commands that were held up and arrive all at once, if no stamp shows their age.

A link that stalls and recovers delivers everything it held back within milliseconds. A backlog is
more than five commands within 20 ms after the source was silent for its timeout (so that they may
be older than that). No command of a backlog is obeyed.

The first five look like ordinary commands, and a single command after a silence must act at once;
waiting would delay every first command by 20 ms. So the first is obeyed, and at the sixth the gate
returns ``revoke``: the arbiter revokes every command since the silence, and stands at once, without
a ramp. If commands that arrived in one piece are all offered before a control step runs, none has
an effect. Otherwise the wheels received the first step of a ramp for some milliseconds, too briefly
for a motor to start. The gate watches for one timeout after the silence, because a backlog may come
in pieces.

While commands keep coming at that rate, they stay refused: a sender without stamps of its own has
to stay below 250 commands a second.

zenoh-bridge-ros2dds may deliver each command several times, once more for each restart of yahboomd
beside it. Copies with the same stamp are one command, and are not counted. Of copies without a
stamp, up to 32 in a row before a gap count as one towards that rate. They cost the first timeout
after a silence, because the first burst might be a backlog.
"""

from __future__ import annotations

from collections import deque
from typing import Literal, TypeAlias

Verdict: TypeAlias = Literal["pass", "revoke", "refuse"]

MOST = 5
"""The commands that may arrive within the window without being a backlog."""
WINDOW_NS = 20_000_000

MOST_COPIES = 32
"""The most commands in a row with the same content that may be copies of one ..."""
ROW_GAP_NS = 5_000_000
"""... and the gap that ends a row. A long backlog that a link delivers has no gap."""


class BacklogGate:
    """Watches the arrivals of one source.

    Args:
        silence_ns: After this time without a command, the next ones are suspect.

    Attributes:
        refusing: Whether the latest command was part of a backlog.
    """

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._recent: deque[int] = deque(maxlen=MOST + 1)
        self._watch_until_ns = 0
        self.refusing = False
        self._since_silence = 0
        self._in_row = 0
        self.watching_since_ns = 0

    def arrive(
        self,
        now_ns: int,
        *,
        arrivals: int,
        proven: bool,
        copy: bool,
        alike: bool,
    ) -> Verdict:
        """Judge a command that arrived at ``now_ns``.

        Args:
            arrivals: The number of commands since the last call, if only the newest is judged.
            proven: The command's stamp shows that it is fresh.
            copy: Its stamp shows that it is a copy of the command before.
            alike: It has the same content as the command before.

        Returns:
            ``pass``; ``revoke`` for the first command of a known backlog: revoke those that passed
            since :attr:`watching_since_ns`; ``refuse`` for each one after that.
        """
        silent = not self._recent or now_ns - self._recent[-1] >= self._silence_ns
        if copy and not silent:
            return "refuse" if self.refusing else "pass"
        in_row = alike and not silent and now_ns - self._recent[-1] <= ROW_GAP_NS
        self._in_row = self._in_row + 1 if in_row else 1
        if silent:
            self._recent.clear()
            self._watch_until_ns = now_ns + self._silence_ns
            self.watching_since_ns = now_ns
            self._since_silence = 0
        if self._in_row == 1 or self._in_row > MOST_COPIES:
            self._since_silence += arrivals
        self._recent.extend([now_ns] * min(arrivals, MOST + 1))
        if proven:
            self.refusing = False
            return "pass"
        dense = len(self._recent) > MOST and self._recent[-1] - self._recent[0] <= WINDOW_NS
        if not dense or now_ns > self._watch_until_ns:
            self.refusing = False
            return "pass"
        elapsed_ns = now_ns - self.watching_since_ns
        if self._since_silence * WINDOW_NS > MOST * elapsed_ns:
            self._watch_until_ns = now_ns + self._silence_ns
        if self.refusing:
            return "refuse"
        self.refusing = True
        return "revoke"
