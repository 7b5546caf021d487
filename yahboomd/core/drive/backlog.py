"""Commands that were held up and arrive all at once, where no stamp shows their age.

A link that stalls and recovers delivers what it held back within milliseconds. More than five
commands within 20 ms, after the source was silent for its timeout (so that what is held back may be
older than that), are a backlog: nothing of it is obeyed.

The trouble is that its first five look like five ordinary commands, and a single command after a
silence has to act at once; to wait and see would cost every first command 20 ms. So the first is
obeyed, and at the sixth the gate says ``revoke``: the arbiter takes everything back that came
since the silence, and stands, at once and not by a ramp. Where commands that arrived in one piece
are all offered before a control step runs, nothing is obeyed in the first place; otherwise the
wheels were sent the first step of a ramp for some milliseconds, too short for a motor to start.
Watching goes on for one timeout after the silence, since a backlog may come in pieces.

While commands keep coming that fast on the whole, they stay refused: a sender without stamps of its
own has to stay below 250 commands a second.

zenoh-bridge-ros2dds may pass each command on several times, once more for each time that yahboomd
was started again beside it. Copies that carry one stamp are one command, and are not counted. Of
copies without a stamp up to 32 in a row count as one towards that rate, where a gap follows: they
cost the first timeout after a silence, because its first burst could as well be a backlog.
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
"""... and the gap that ends a row. A link that lets a long backlog through has no gap."""


class BacklogGate:
    """Watches the arrivals of one source.

    Args:
        silence_ns: How long nothing arrived for when what arrives next is suspect.
    """

    def __init__(self, silence_ns: int) -> None:
        self._silence_ns = silence_ns
        self._recent: deque[int] = deque(maxlen=MOST + 1)
        self._watch_until_ns = 0
        self._within = False
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
        """Judge what arrived at ``now_ns``.

        Args:
            arrivals: How many commands arrived since the last call, where only the newest is
                looked at.
            proven: The command's stamp shows that it is fresh.
            copy: It is the command before it once more, as its stamp shows.
            alike: It says the same as the command before it.

        Returns:
            ``pass``; or ``revoke`` for the first that is known to be of a backlog: take back what
            passed since :attr:`watching_since_ns`; or ``refuse`` for each one after that.
        """
        silent = not self._recent or now_ns - self._recent[-1] >= self._silence_ns
        if copy and not silent:
            return "refuse" if self._within else "pass"
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
            self._within = False
            return "pass"
        dense = len(self._recent) > MOST and self._recent[-1] - self._recent[0] <= WINDOW_NS
        if not dense or now_ns > self._watch_until_ns:
            self._within = False
            return "pass"
        elapsed_ns = now_ns - self.watching_since_ns
        if self._since_silence * WINDOW_NS > MOST * elapsed_ns:
            self._watch_until_ns = now_ns + self._silence_ns
        if self._within:
            return "refuse"
        self._within = True
        return "revoke"
