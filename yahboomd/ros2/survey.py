"""A query to other sessions that is repeated, and never waits for its answers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TypeAlias, TypeVar

import msgspec
import zenoh
from zenoh.handlers import Callback

from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.inbox import SampleLane

MOST_REPLIES = 64
"""Answers kept of a round; anybody may send any number of them."""

LONGEST_REPLY = 16_384
"""Bytes of an answer; longer ones are dropped."""

ROUND_S = 2.0
"""The longest that a round takes."""

Round: TypeAlias = tuple[int, list[bytes]]
"""The number of a session of ours, and the answers that came there."""

Answer = TypeVar("Answer")


def decoded(answers: list[bytes], kind: type[Answer]) -> list[Answer]:
    """The answers in JSON that are of a kind."""
    found = list[Answer]()
    for answer in answers:
        with suppress(ValueError, RecursionError):
            found.append(msgspec.json.decode(answer, type=kind))
    return found


class Survey:
    """A question to other sessions.

    Args:
        bus: An open bus.
        selector: The key expression.
        handler: Takes the answers of the latest round in each session, on the loop.
    """

    def __init__(self, bus: Bus, selector: str, handler: Callable[[list[bytes]], None]) -> None:
        self._selector = bus.key(selector)
        self._handler = handler
        self._lane: SampleLane[Round] = bus.inbox().lane(self._deliver, depth=8)
        self._sessions: list[zenoh.Session] = []
        self._latest: dict[int, list[bytes]] = {}
        bus.declare(self)

    def attach(self, session: zenoh.Session) -> None:
        self._sessions.append(session)

    def ask(self) -> None:
        for index, session in enumerate(self._sessions):
            self._ask(index, session)

    def _ask(self, index: int, session: zenoh.Session) -> None:
        answers: list[bytes] = []

        def answered(reply: zenoh.Reply) -> None:
            sample = reply.ok
            if sample is None or len(answers) >= MOST_REPLIES:
                return
            if len(sample.payload) <= LONGEST_REPLY:
                answers.append(sample.payload.to_bytes())

        session.get(
            self._selector,
            Callback(answered, lambda: self._lane.offer((index, answers)), indirect=False),
            target=zenoh.QueryTarget.ALL,
            timeout=ROUND_S,
            congestion_control=zenoh.CongestionControl.DROP,
        )

    def _deliver(self, rounds: list[Round], _lost: int) -> None:
        self._latest.update(rounds)
        self._handler([answer for answers in self._latest.values() for answer in answers])
