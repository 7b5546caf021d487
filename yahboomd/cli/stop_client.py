"""The bus half of ``yahboomd stop``: the daemon's emergency stop, engaged or released."""

from __future__ import annotations

import asyncio

import msgspec

from yahboomd.bus import keys
from yahboomd.bus.subscriptions import Arrival
from yahboomd.cli.bus_client import BusClient, client_options
from yahboomd.cli.incoming import read_sample
from yahboomd.cli.words import listed
from yahboomd.config import Config
from yahboomd.errors import BusError
from yahboomd.messages.native import StatusSample, WheelsSample

STANDING_M_S = 0.03
"""A wheel that is slower counts as standing."""

STAND_WITHIN_S = 2.0
SAMPLES = 3
"""So many samples in a row must show it, in case one was under way when the stop was engaged."""


class BusStop(msgspec.Struct, frozen=True, kw_only=True):
    """What the daemon did.

    Attributes:
        stood: Its wheels were seen to stand.
        words: What it said and what was seen, for a person.
    """

    stood: bool
    words: str


class _Wheels:
    """Watches the daemon's samples until the wheels stand."""

    def __init__(self) -> None:
        self.standing = asyncio.Event()
        self.status: StatusSample | None = None
        self.fastest_m_s: float | None = None
        self._slow = 0

    def forget(self) -> None:
        self.standing.clear()
        self._slow = 0

    def wheels(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            sample = read_sample(arrival.payload, WheelsSample)
            if sample is not None and sample.speed_m_s:
                self.fastest_m_s = max(map(abs, sample.speed_m_s))
                self._slow = self._slow + 1 if self.fastest_m_s < STANDING_M_S else 0
                if self._slow >= SAMPLES:
                    self.standing.set()

    def status_samples(self, arrivals: list[Arrival]) -> None:
        for arrival in arrivals:
            self.status = read_sample(arrival.payload, StatusSample) or self.status


async def engage(
    endpoints: tuple[str, ...], config: Config, *, within_s: float = STAND_WITHIN_S
) -> BusStop | None:
    """Engage the emergency stop of every daemon there, and watch the wheels.

    Args:
        endpoints: Where the daemon is reached.
        config: Names the namespace, and Zenoh's own file.
        within_s: How long to watch for standing wheels.

    Returns:
        What came of it; None where no daemon answers.
    """
    client = BusClient(client_options(endpoints, config))
    try:
        await client.open()
    except BusError:
        return None
    watch = _Wheels()
    try:
        client.subscribe(keys.WHEELS, watch.wheels)
        client.subscribe(keys.STATUS, watch.status_samples, max_bytes=1 << 18)
        answer = await client.request(keys.ESTOP, urgent=True)
        if not answer.answered:
            return None
        watch.forget()
        stood = False
        if answer.success:
            try:
                async with asyncio.timeout(within_s):
                    stood = await watch.standing.wait()
            except TimeoutError:
                stood = False
    finally:
        await client.close()
    return BusStop(stood=stood, words=f"{answer.message} {_seen(watch, stood=stood)}")


def _seen(watch: _Wheels, *, stood: bool) -> str:
    if stood:
        return "The wheels stand. To drive again: yahboomd stop --release"
    if watch.fastest_m_s is not None:
        return f"The wheels still turn, at {watch.fastest_m_s:.2f} m/s: switch their supply off."
    why = f" ({watch.status.why})" if watch.status is not None else ""
    return f"The daemon tells nothing of the wheels{why}: look at them."


def release(endpoints: tuple[str, ...], config: Config) -> str:
    """Release the emergency stop; what the daemon says to it.

    Raises:
        BusError: No daemon answers, or it refuses.
    """
    return asyncio.run(_release(endpoints, config))


async def _release(endpoints: tuple[str, ...], config: Config) -> str:
    client = BusClient(client_options(endpoints, config))
    try:
        await client.open()
    except BusError as error:
        raise nobody(endpoints) from error
    try:
        answer = await client.request(keys.ESTOP_RESET)
    finally:
        await client.close()
    if not answer.answered:
        raise nobody(endpoints)
    if not answer.success:
        raise Refused(answer.message)
    return answer.message


class Refused(BusError):
    """The daemon answered, and does not do it."""

    exit_code = 1


def nobody(endpoints: tuple[str, ...]) -> BusError:
    """No daemon answers, as the error to raise."""
    return BusError(
        f"No daemon answers at {listed(endpoints)}.",
        remedy="Is it running, under this namespace (--namespace)? --connect names another place.",
    )
