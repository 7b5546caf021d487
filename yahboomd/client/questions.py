"""Queries to the daemon's services, and the answers of several daemons combined."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any

import msgspec
import zenoh

from yahboomd.client.streams import read_sample
from yahboomd.core.bus.blocking import bounded
from yahboomd.core.messages.native import ServiceReply

GRACE_S = 0.5
"""A query that has not ended this long after its own timeout never will."""


class Answer(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a request.

    Attributes:
        success: Whether every daemon that answered did it.
        message: The daemon's report of success, or its reason against it; a sentence of ours if no
            daemon answered.
        answered: How many daemons answered.
        data: The values that the first of them returned, by name.
    """

    success: bool
    message: str
    answered: int
    data: dict[str, Any] = {}


async def ask(
    session: zenoh.Session,
    key: str,
    payload: bytes = b"{}",
    *,
    timeout_s: float = 1.5,
    urgent: bool = False,
) -> list[bytes]:
    """Query a key at every daemon, off the event loop.

    Args:
        key: The key in full.
        payload: The request. Its encoding is also that of the answer.
        urgent: Overtakes other messages on the way.

    Returns:
        The payload of each answer; empty if no daemon answers in time.
    """

    def get() -> list[bytes]:
        return list(_payloads(_query(session, key, payload, timeout_s, urgent)))

    try:
        return await bounded(get, timeout_s=timeout_s + GRACE_S, name="client-ask")
    except (TimeoutError, zenoh.ZError):
        return []


async def ask_urgently(
    session: zenoh.Session, keys_in_full: Sequence[str], payload: bytes, *, timeout_s: float = 1.5
) -> list[list[bytes]]:
    """Query several keys at once, urgently, off the event loop.

    They go out together and arrive in this order. A key that nothing knows, or that an access rule
    drops, keeps no other one from being asked or answered.

    Returns:
        For each key the payload of each answer.
    """
    found: list[list[bytes]] = [[] for _ in keys_in_full]

    def get() -> None:
        asked = []
        for key, payloads in zip(keys_in_full, found, strict=True):
            with suppress(zenoh.ZError):
                asked.append((_query(session, key, payload, timeout_s, urgent=True), payloads))
        # The last one's first: a query that nothing answers may end with its timeout.
        for replies, payloads in reversed(asked):
            payloads.extend(_payloads(replies))

    with suppress(TimeoutError):
        await bounded(get, timeout_s=timeout_s + GRACE_S, name="client-ask")
    return [list(each) for each in found]


def which_count(named: list[bytes], common: list[bytes]) -> list[bytes]:
    """Of one request by a person's key and by the common one, the answers that count.

    Those by the person's key, unless not every daemon gave one, or one refused.
    """
    if len(named) < len(common):
        return common
    # What was refused on one key and done on the other was done.
    return common if common and not read_answers(named).success else named


def _query(
    session: zenoh.Session, key: str, payload: bytes, timeout_s: float, urgent: bool
) -> Iterable[zenoh.Reply]:
    return session.get(
        key,
        # Every daemon that is there, not the nearest one: an emergency stop is for all.
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout_s,
        congestion_control=zenoh.CongestionControl.BLOCK,
        priority=zenoh.Priority.REAL_TIME if urgent else zenoh.Priority.DATA,
        express=urgent,
        payload=payload,
        encoding="application/json",
    )


def _payloads(replies: Iterable[zenoh.Reply]) -> Iterator[bytes]:
    return (reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None)


def silence_of(payloads: list[bytes], source: str) -> float | None:
    """How long daemons wait for a source before they stop the robot, by their configurations.

    Returns:
        Seconds, the shortest of several daemons; None if no answer has it.
    """
    found = list[float]()
    for payload in payloads:
        command = _group((read_sample(payload, ServiceReply) or _NOTHING).data, "command")
        own = _group(_group(command, "sources"), source).get("timeout_s")
        silence_s = own if own is not None else command.get("timeout_s")
        if isinstance(silence_s, int | float) and silence_s > 0.0:
            found.append(float(silence_s))
    return min(found, default=None)


_NOTHING = ServiceReply(success=False, message="")


def _group(facts: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = facts.get(name)
    return found if isinstance(found, Mapping) else {}


def read_answers(payloads: list[bytes]) -> Answer:
    """Combine the answers of a service; an unreadable one counts as a refusal."""
    replies = [
        read_sample(payload, ServiceReply)
        or ServiceReply(success=False, message="An answer cannot be read.")
        for payload in payloads
    ]
    if not replies:
        return Answer(success=False, message="No daemon answered.", answered=0)
    return Answer(
        success=all(reply.success for reply in replies),
        message=" ".join(dict.fromkeys(reply.message for reply in replies)),
        answered=len(replies),
        data=dict(replies[0].data),
    )
