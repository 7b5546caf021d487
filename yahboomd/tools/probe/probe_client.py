"""Asks the daemon that holds the port about its board."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, TypeAlias

import msgspec

from yahboomd.client import AsyncRobot
from yahboomd.client.streams import read_sample
from yahboomd.core.bus import keys
from yahboomd.core.config import Config
from yahboomd.core.errors import BusError
from yahboomd.core.link.line import ReceivedSample
from yahboomd.core.messages.native import ServiceReply
from yahboomd.core.protocol.dialect import FramerCounters
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import VERSION, BoardSettings
from yahboomd.tools.port.probing import Examination
from yahboomd.tools.robot.daemon_address import client_options

Numbers: TypeAlias = int | float | tuple[float, float, float]


class Reported(NamedTuple):
    """A daemon's report of its board.

    Attributes:
        found: The board's facts, as a probe of the port finds them; None if it has no board.
    """

    port: str
    found: Examination | None


async def ask_board(endpoints: tuple[str, ...], config: Config) -> Reported | None:
    """Ask the daemon for the board's facts; None if no daemon answers."""
    robot = AsyncRobot(client_options(endpoints, config))
    try:
        await robot.join(0.0)
        payloads = await robot.ask(keys.BOARD)
    except BusError:
        return None
    finally:
        await robot.close()
    replies = [read_sample(payload, ServiceReply) for payload in payloads]
    for reply in replies:
        if reply is not None and reply.success:
            found = examination(reply.data)
            if found is not None:
                return Reported(str(reply.data.get("port", "")), found)
    return Reported("", None) if any(replies) else None


def examination(facts: Mapping[str, Any]) -> Examination | None:
    """Convert a daemon's report to the result of a probe; None if it cannot be read.

    Args:
        facts: The data of ``yahboomd/board``.
    """
    dialect = DIALECTS.get(str(facts.get("dialect")))
    if dialect is None:
        return None
    known: dict[str, Any] = {}
    for row in dialect.settings:
        parts = tuple(facts.get(part) for part in row.parts)
        known[row.field] = facts.get(row.field) if not parts else None if None in parts else parts
    try:
        shown = {field: value for field, value in known.items() if value is not None}
        settings: BoardSettings = msgspec.convert(shown, dict[str, Numbers])
        settings[VERSION] = msgspec.convert(facts.get(VERSION), str | None) or ""
        volts = msgspec.convert(facts.get("volts"), float | None)
    except msgspec.ValidationError:
        return None
    return Examination(
        dialect=dialect,
        settings=settings if dialect.read_settings else None,
        volts=volts,
        heard=ReceivedSample(counters=FramerCounters()),
    )
