"""The interface of every simulated board: a state machine whose time is an argument."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias, runtime_checkable

from yahboomd.core.model import Counts

Emit: TypeAlias = Callable[[bytes, int], None]
"""Receives a board's bytes, with the time at which the first one leaves."""

NEVER = 2**63 - 1
"""Later than any moment."""

BOOT_NS = 60_000_000
"""The time from power or reset to the first useful instruction; motors are off, bytes are lost."""


class BoardModel(Protocol):
    """A board that is fed bytes and moved through time.

    Moments only grow. Nothing happens between calls: the next call of :meth:`run_due` does
    everything due, at its own exact time.
    """

    emit: Emit

    @property
    def next_ns(self) -> int:
        """The time of the next thing that happens inside."""

    @property
    def speaks_ns(self) -> int:
        """The next moment at which it may send, :data:`NEVER` while it waits for a command."""

    @property
    def totals(self) -> Counts:
        """The counters, as the latest interrupt left them."""

    def receive(self, byte: int, now_ns: int) -> None:
        """One byte has arrived completely; the caller has run everything due until ``now_ns``."""

    def run_due(self, now_ns: int) -> None:
        """Run everything due up to ``now_ns``."""

    def start(self, now_ns: int) -> None:
        """Start as a board that was powered long ago: running, silent, counters kept."""

    def reset(self, now_ns: int, *, off_ns: int = 0, by_power: bool) -> None:
        """Lose all but the flash, release the motors, and start again after ``off_ns``.

        Args:
            off_ns: How long it stays without power.
            by_power: Whether power failed, rather than a reset by software.
        """

    def set_tick_period(self, now_ns: int, period_ns: int, jitter_ns: int = 0) -> None:
        """Renew the totals every ``period_ns`` from now on, or with every line if it is 0.

        Raises:
            ValueError: This board has no such period.
        """

    def hang(self) -> None:
        """Stop executing, for good, with the outputs as they are."""


@runtime_checkable
class FlashWriter(Protocol):
    """A board that can lose its supply within a write of its flash.

    Attributes:
        cut_writes: The number of writes, from the next one on, within which the supply fails.
    """

    cut_writes: int
