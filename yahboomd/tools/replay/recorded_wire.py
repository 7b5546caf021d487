"""Prepares the bytes of a recording for a board that plays them again.

It takes out the questions for the board's identity and settings, with their answers, because
another daemon asks them at other moments. All other bytes of the board keep their moments.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import msgspec

from yahboomd.blackbox.records import (
    Anchor,
    Closed,
    Identified,
    Opened,
    Received,
    Record,
    Written,
)
from yahboomd.core.link.start_notices import LATEST_ANSWER_NS, StartNotices
from yahboomd.core.protocol.dialect import Battery, Decoded, Dialect, Reply, Setting, VersionLine
from yahboomd.core.protocol.registry import DIALECTS


class Piece(NamedTuple):
    """Bytes of the board.

    Attributes:
        at_ns: When they came: on the recording's clock, or after their question.
        whole: Whether they end together with a frame or a line of the board.
    """

    at_ns: int
    data: bytes
    whole: bool = True


class Poll(NamedTuple):
    """A request for the counters.

    Attributes:
        answer: The bytes until the next request, by their delays.
    """

    at_ns: int
    answer: list[Piece]


class WireRecord(msgspec.Struct, kw_only=True):
    """The bytes between the opening and the closing of a port.

    Attributes:
        stream: The bytes that the board sent unasked, from the request to stream its counts on.
        begins_ns: The moment of that request.
        ends_ns: The end of the stream.
        answers: The answers to each question, in the order of asking.
        polls: For a board that is asked for its counters, each request with its answer.
    """

    dialect: Dialect
    stream: list[Piece]
    begins_ns: int
    ends_ns: int
    answers: dict[bytes, list[list[Piece]]]
    polls: list[Poll]

    @property
    def poll_gap_ns(self) -> int:
        """The median time between two polls."""
        gaps = [after.at_ns - before.at_ns for before, after in pairwise(self.polls)]
        return round(median(gaps)) if gaps else 0


def connections(records: Iterable[Record]) -> list[WireRecord]:
    """The connections of a recording with a known board."""
    found = []
    for dialect, records_of_it in _split(records):
        each = connection(DIALECTS[dialect], records_of_it)
        if each.stream or any(poll.answer for poll in each.polls):
            found.append(each)
    return found


def _split(records: Iterable[Record]) -> Iterator[tuple[str, list[Record]]]:
    """Each connection's bytes, with the name of its dialect."""
    dialect, bytes_of_it = "", list[Record]()
    for record in records:
        meaning = record.meaning
        if isinstance(meaning, Opened | Closed):
            if dialect in DIALECTS:
                yield dialect, bytes_of_it
            dialect, bytes_of_it = "", []
        elif isinstance(meaning, Anchor | Identified):
            dialect = dialect or meaning.dialect
        elif isinstance(meaning, Received | Written):
            bytes_of_it.append(record)
    if dialect in DIALECTS:
        yield dialect, bytes_of_it


def connection(dialect: Dialect, records: list[Record]) -> WireRecord:
    """Sort the bytes of one connection into stream, answers and polls."""
    made = WireRecord(
        dialect=dialect,
        stream=[],
        begins_ns=records[0].at_ns if records else 0,
        ends_ns=records[-1].at_ns if records else 0,
        answers={},
        polls=[],
    )
    if dialect.poll is not None:
        made.polls = _polls(dialect.poll, records)
        if made.polls:
            made.begins_ns = made.polls[0].at_ns
        return made
    if dialect.arm and not dialect.listen_ns:
        armed = (
            at_ns
            for at_ns, meaning in records
            if isinstance(meaning, Written) and dialect.arm[0] in meaning.data
        )
        made.begins_ns = next(armed, made.begins_ns)
    _sort(made, records)
    return made


def _polls(question: bytes, records: list[Record]) -> list[Poll]:
    polls: list[Poll] = []
    for at_ns, meaning in records:
        if isinstance(meaning, Written) and question in meaning.data:
            polls.append(Poll(at_ns, []))
        elif isinstance(meaning, Received) and polls:
            polls[-1].answer.append(Piece(at_ns - polls[-1].at_ns, meaning.data))
    return polls


def _sort(made: WireRecord, records: list[Record]) -> None:
    """Separate the answers from the stream."""
    dialect = made.dialect
    questions = questions_of(dialect)
    framer, notices = dialect.framer(), StartNotices()
    came = bytearray()
    chunks: list[tuple[int, int, bool]] = []
    taken: list[tuple[int, int]] = []
    asked: tuple[bytes, int] | None = None
    for at_ns, meaning in records:
        if isinstance(meaning, Written):
            for question in questions:
                if question in meaning.data:
                    notices.asked(at_ns)
                    asked = question, at_ns
                    made.answers.setdefault(question, []).append([])
        elif isinstance(meaning, Received):
            came += meaning.data
            for item in framer.feed(meaning.data):
                decoded = dialect.decode(item)
                starts = notices.judge(decoded, at_ns) == "start"
                if asked is None or starts or at_ns - asked[1] > LATEST_ANSWER_NS:
                    continue
                if isinstance(decoded, questions[asked[0]]) and _answers(decoded):
                    end = len(came) - item.trailing
                    taken.append((end - item.size, end))
                    piece = Piece(at_ns - asked[1], bytes(came[end - item.size : end]))
                    made.answers[asked[0]][-1].append(piece)
            chunks.append((at_ns, len(came), framer.held_bytes == 0))
    begin = 0
    for at_ns, end, whole in chunks:
        data = _without(came, begin, end, taken)
        if at_ns >= made.begins_ns and data:
            made.stream.append(Piece(at_ns, data, whole))
        begin = end


def _answers(decoded: Decoded) -> bool:
    """Whether it cannot be the reply to a command."""
    return not isinstance(decoded, Reply) or decoded.settings_follow


def _without(came: bytearray, begin: int, end: int, taken: list[tuple[int, int]]) -> bytes:
    left = bytearray()
    for first, last in taken:
        if last > begin and first < end:
            left += came[begin : max(begin, first)]
            begin = min(end, last)
    return bytes(left + came[begin:end])


def questions_of(dialect: Dialect) -> dict[bytes, tuple[type[msgspec.Struct], ...]]:
    """The questions that a board answers, and the types of their answers."""
    found: dict[bytes, tuple[type[msgspec.Struct], ...]] = {}
    for question in (dialect.probe, *dialect.read_settings):
        if question is not None:
            found[question] = (Reply, Setting, VersionLine)
    # A board that reports unasked sends its voltage all the time.
    if dialect.battery is not None and not dialect.listen_ns:
        found[dialect.battery] = (Battery,)
    return found
