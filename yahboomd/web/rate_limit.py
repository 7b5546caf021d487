"""Limits the failures of an address: a burst at once, then one every few seconds."""

from __future__ import annotations

import ipaddress

from yahboomd.core.clock import Clock
from yahboomd.core.model import NS_PER_S

ADDRESSES = 1024
"""The number of addresses remembered; the one with the oldest latest failure is dropped."""


class RateLimit:
    """Failures by address.

    Args:
        burst: Failures that are allowed at once.
        every_s: The seconds after which another one is allowed.
    """

    def __init__(self, clock: Clock, *, burst: int, every_s: float) -> None:
        self._clock = clock
        self._every_ns = round(every_s * NS_PER_S)
        self._most_ns = burst * self._every_ns
        # The time at which all failures of an address are forgiven.
        self._until_ns: dict[str, int] = {}

    def wait_s(self, address: str) -> int:
        """Whole seconds until this address may try again; 0 if it may now."""
        left_ns = self._until_ns.get(_network(address), 0) - self._clock.now_ns()
        over_ns = left_ns - self._most_ns + self._every_ns
        return -(-over_ns // NS_PER_S) if over_ns > 0 else 0

    def failed(self, address: str) -> None:
        """Count a failure."""
        network, now_ns = _network(address), self._clock.now_ns()
        until_ns = max(now_ns, self._until_ns.pop(network, 0)) + self._every_ns
        if len(self._until_ns) >= ADDRESSES:
            del self._until_ns[next(iter(self._until_ns))]
        self._until_ns[network] = until_ns


def _network(address: str) -> str:
    """The address; for IPv6 its /64, since one machine may use all of that."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    if found.version == 4:
        return address
    return str(ipaddress.ip_network((found, 64), strict=False))
