"""A recorded board as the device behind a port: it answers questions, and plays the rest again.

It answers questions for its identity and settings at once, as the recorded board did. The recording
begins when the host asks the board to report its counts, or opens the port of a board that reports
unasked: from then on every byte keeps its recorded delay. A board that is asked for its counters
answers each request with the recorded answer nearest in time, after the same delay. So the counts
have their true times at any rate of polls, and at the recorded rate none is left out. Commands for
the wheels are only counted.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Callable
from contextlib import suppress

from yahboomd.core.model import CHANNELS
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.tools.replay.recorded_wire import Piece, WireRecord, questions_of

WAKE_NS = 10_000_000
"""The period at which the port is checked for a process that opens it."""

LAST_WORDS_NS = 100_000_000
"""From the last byte of a connection to the end of its port, for the host to read."""

UNPLUGGED_NS = 500_000_000
"""The time without a port between two connections of a recording."""

NEVER = 2**63 - 1


class ReplayedBoard:
    """The device side of a recording; see :class:`yahboomd.simulation.pty.Device`.

    Args:
        recorded: The connections, at least one, in their order.
        otherwise: Answers a question that the recorded board was never asked.

    Attributes:
        on_plug: Called when the port goes away between connections, and comes back.
        on_end: Called once everything was played.
        counters: The host's commands and questions, and the bytes played.
        played_ns: The played time of the connections that are over.
    """

    def __init__(
        self, recorded: list[WireRecord], otherwise: Callable[[Dialect, bytes], bytes]
    ) -> None:
        self._recorded = recorded
        self._otherwise = otherwise
        self.on_plug: Callable[[bool], None] | None = None
        self.on_end: Callable[[], None] = lambda: None
        self.counters = Counter[str](motions=0, stops=0, polls=0, questions=0, bytes=0)
        self.played_ns = 0
        self._farthest_ns = 0
        self._index = 0
        self._now_ns = 0
        self._over_ns = NEVER
        self._unplugged = False
        self._begin()

    @property
    def connection(self) -> WireRecord:
        """The connection that is played."""
        return self._recorded[self._index]

    @property
    def total_ns(self) -> int:
        """The duration of all connections together."""
        return sum(each.ends_ns - each.begins_ns for each in self._recorded)

    def _begin(self) -> None:
        """Become a board that was not asked anything yet."""
        self._words = _Words(self.connection.dialect)
        self._started_ns: int | None = None
        self._sent = 0
        self._polled = 0
        self._whole = True
        self._answered = Counter[bytes]()
        self._answers: list[tuple[int, bytes]] = []

    def start(self, now_ns: int) -> None:
        """Begin at this moment."""
        self._now_ns = now_ns

    def host_is_there(self, present: bool) -> None:
        """Start the connection from its beginning when a process opens the port, or closes it."""
        if self._over_ns == NEVER:
            self._farthest_ns = self.farthest_ns
            self._begin()
            if present and self.connection.dialect.listen_ns:
                self._started_ns = self._now_ns

    @property
    def next_ns(self) -> int:
        """The next moment at which :meth:`host_reads` is worth calling."""
        wake_ns = min(self._now_ns + WAKE_NS, self._over_ns)
        if self._answers and self._whole:
            wake_ns = min(wake_ns, self._answers[0][0])
        if self._started_ns is not None and self._sent < len(self.connection.stream):
            wake_ns = min(wake_ns, self._due_ns(self.connection.stream[self._sent].at_ns))
        return max(wake_ns, self._now_ns + 1)

    def host_reads(self, now_ns: int) -> list[bytes]:
        """The chunks that the recorded board has sent by now."""
        self._now_ns = now_ns
        if now_ns >= self._over_ns:
            self._turn_over(now_ns)
            return []
        chunks = self._due_answers(now_ns)
        if self._started_ns is not None:
            stream = self.connection.stream
            while self._sent < len(stream) and self._due_ns(stream[self._sent].at_ns) <= now_ns:
                chunks.append(stream[self._sent].data)
                self._whole = stream[self._sent].whole
                self._sent += 1
                chunks += self._due_answers(now_ns)
            if self._over_ns == NEVER and self._due_ns(self.connection.ends_ns) <= now_ns:
                self._over_ns = now_ns + LAST_WORDS_NS
        self.counters["bytes"] += sum(map(len, chunks))
        return chunks

    def host_wrote(self, data: bytes, now_ns: int) -> None:
        """Answer questions, and count commands."""
        self._now_ns = now_ns
        for role, frame in self._words.find(data):
            if role == "arm":
                if self._started_ns is None:
                    self._started_ns = now_ns
            elif role == "polls":
                self._poll(now_ns)
            elif role == "questions":
                self._answer(frame, now_ns)
            if role != "arm":
                self.counters[role] += 1

    def host_backlog_ns(self, now_ns: int) -> int:  # noqa: ARG002 (the seam's shape)
        """Return 0: what the host writes arrives at once."""
        return 0

    def _due_ns(self, at_ns: int) -> int:
        assert self._started_ns is not None
        return self._started_ns + at_ns - self.connection.begins_ns

    @property
    def elapsed_ns(self) -> int:
        """The played time, over all connections."""
        if self._started_ns is None or self._over_ns != NEVER:
            return self.played_ns
        connection = self.connection
        return self.played_ns + min(
            self._now_ns - self._started_ns, connection.ends_ns - connection.begins_ns
        )

    @property
    def farthest_ns(self) -> int:
        """The longest time that any host has played."""
        return max(self._farthest_ns, self.elapsed_ns)

    def _turn_over(self, now_ns: int) -> None:
        """End a connection: the port goes away, and comes back if another one follows."""
        if self._unplugged:
            self._unplugged, self._over_ns = False, NEVER
            self._index += 1
            self._begin()
            if self.on_plug is not None:
                self.on_plug(True)
            return
        connection = self.connection
        self.played_ns += connection.ends_ns - connection.begins_ns
        self.counters["connections"] += 1
        if self._index + 1 == len(self._recorded):
            self._over_ns = NEVER - 1
            self.on_end()
            return
        self._unplugged, self._over_ns = True, now_ns + UNPLUGGED_NS
        if self.on_plug is not None:
            self.on_plug(False)

    def _due_answers(self, now_ns: int) -> list[bytes]:
        """The answers that are due, held back while a frame of the stream is half sent."""
        found = []
        while self._answers and self._whole and self._answers[0][0] <= now_ns:
            found.append(self._answers.pop(0)[1])
        return found

    def _say(self, pieces: list[Piece], now_ns: int) -> None:
        self._answers += [(now_ns + piece.at_ns, piece.data) for piece in pieces]
        self._answers.sort(key=lambda answer: answer[0])

    def _answer(self, question: bytes, now_ns: int) -> None:
        connection, others = self.connection, self._recorded
        known = [answer for answer in connection.answers.get(question, []) if answer]
        # Its own may have been asked before the recording began; another connection's are as good.
        known = known or [a for each in others for a in each.answers.get(question, []) if a]
        if known:
            turn = min(self._answered[question], len(known) - 1)
            self._answered[question] += 1
            self._say(known[turn], now_ns)
        else:
            self._say([Piece(0, self._otherwise(connection.dialect, question))], now_ns)

    def _poll(self, now_ns: int) -> None:
        polls = self.connection.polls
        if self._started_ns is None:
            self._started_ns = now_ns
        else:
            half_ns = self.connection.poll_gap_ns // 2
            while (
                self._polled + 1 < len(polls)
                and self._due_ns(polls[self._polled + 1].at_ns) <= now_ns + half_ns
            ):
                self._polled += 1
        self._say(polls[self._polled].answer, now_ns)


class _Words:
    """Finds the frames of the host that a board of one dialect reacts to."""

    def __init__(self, dialect: Dialect) -> None:
        roles = {_motion_head(dialect): "motions", dialect.brake: "stops"}
        if dialect.cut is not None:
            roles[dialect.cut] = "stops"
        roles |= dict.fromkeys(dialect.arm, "arm")
        roles |= dict.fromkeys(questions_of(dialect), "questions")
        if dialect.poll is not None:
            roles[dialect.poll] = "polls"
        self._roles = roles
        longest_first = sorted(roles, key=len, reverse=True)
        self._pattern = re.compile(b"|".join(map(re.escape, longest_first)), re.DOTALL)
        self._kept = len(longest_first[0]) - 1
        self._held = b""

    def find(self, data: bytes) -> list[tuple[str, bytes]]:
        """The frames that are complete now, in their order."""
        text, found, end = self._held + data, [], 0
        for match in self._pattern.finditer(text):
            found.append((self._roles[match[0]], match[0]))
            end = match.end()
        self._held = text[max(end, len(text) - self._kept) :]
        return found


def _motion_head(dialect: Dialect) -> bytes:
    """The bytes with which every command for the wheels begins."""
    for size in (CHANNELS, 3):
        # Speeds of four wheels, or a body's velocity.
        with suppress(ValueError):
            moving = [dialect.speeds((units,) * size) for units in (1, -2)]
            alike = itertools.takewhile(
                lambda same: len(set(same)) == 1, zip(*moving, strict=False)
            )
            return bytes(first for first, _ in alike)
    raise AssertionError(dialect.name)
