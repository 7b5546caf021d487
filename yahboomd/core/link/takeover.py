"""Bring the wheels to rest on a port whose owner is gone.

The board holds the last command for ever, so the process that drove it may be long dead. This
depends on no earlier knowledge: it stops the board that is there, identifies it,
and reads the counters until the wheels stand.
"""

from __future__ import annotations

import msgspec

from yahboomd.core.clock import Clock, seconds
from yahboomd.core.errors import BoardSilent
from yahboomd.core.link.conversation import Conversation
from yahboomd.core.link.line import Line, ReceivedSample
from yahboomd.core.link.port import Port, adopt
from yahboomd.core.link.seize import Seized
from yahboomd.core.link.stopping import stop_unidentified


class TakeoverReport(msgspec.Struct, frozen=True, kw_only=True):
    """The outcome of a stop on a port.

    Attributes:
        dialect: The dialect of the board; None if none answered.
        stood: The counters showed standstill; None if no counts came.
        cut: The motors did not obey the brake, and were released in full motion.
        within_s: From the first stop frame until standstill was seen, or it was given up.
    """

    port: str
    dialect: str | None
    stood: bool | None
    cut: bool
    within_s: float
    heard: ReceivedSample


async def take_over(port: Port, clock: Clock, *, spoken_ns: int | None = None) -> TakeoverReport:
    """Stop, identify, brake, watch, cut, and release the port. Bounded: four seconds at most.

    Args:
        port: The open port; it is closed in the end.
        spoken_ns: When the stop of an unknown board was sent on this port; None if not yet.

    Raises:
        PortLost: The port went away.
    """
    began_ns = clock.now_ns() if spoken_ns is None else spoken_ns
    line = Line(port, clock)
    async with line.attended():
        talk = None
        try:
            talk = await Conversation.begin(line, stop_first=spoken_ns is None)
        except BoardSilent:
            # It may receive although it does not answer: once more, besides the one at leaving.
            await stop_unidentified(port, clock)
        within_s = seconds(clock.now_ns() - began_ns)
        report = None if talk is None else await talk.rest()
        return TakeoverReport(
            port=port.name,
            dialect=None if talk is None else talk.dialect.name,
            stood=None if report is None else report.stood,
            cut=report is not None and report.cut,
            within_s=within_s + (0.0 if report is None else report.took_s),
            heard=line.heard,
        )


async def take_over_seized(seized: Seized, clock: Clock) -> TakeoverReport:
    """The same on a port that was seized, which has sent the first stop.

    Raises:
        PortLost: The port went away.
    """
    return await take_over(await adopt(seized, clock), clock, spoken_ns=seized.spoken_ns)
