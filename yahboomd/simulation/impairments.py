"""Faults of the line between host and board, seeded."""

from __future__ import annotations

from random import Random

import msgspec

from yahboomd.core.clock import nanoseconds
from yahboomd.simulation.options import ImpairmentOptions


class Impairments:
    """The state of the line; every attribute may be changed at any time.

    Attributes:
        settings: Loss, corruption, delays and chunks.
        muted_until_ns: Until then the board's output is lost.
        babbles_until_ns: Until then random bytes arrive instead, as fast as the wire goes.
        stalled_until_ns: Until then the adapter takes no output of the host.
        held_until_ns: Until then the adapter holds the board's output, and then delivers it all.
        unanswered: First bytes of answers that are lost, each with its probability.
    """

    def __init__(self, settings: ImpairmentOptions, random: Random) -> None:
        self.settings = settings
        self.muted_until_ns = 0
        self.babbles_until_ns = 0
        self.stalled_until_ns = 0
        self.held_until_ns = 0
        self.unanswered: dict[bytes, float] = {}
        self._random = random

    def change(self, **settings: float | bool) -> None:
        """Replace some of the settings by name.

        Raises:
            ValueError: A share outside 0 to 1, or a negative time.
        """
        for name, value in settings.items():
            if value < 0 or (name in ("loss", "corruption") and value > 1):
                raise ValueError(f"{name} cannot be {value}")
        self.settings = msgspec.structs.replace(self.settings, **settings)

    def clear(self) -> None:
        """A perfect line from now on."""
        self.settings = ImpairmentOptions()
        self.muted_until_ns = self.babbles_until_ns = 0
        self.stalled_until_ns = self.held_until_ns = 0
        self.unanswered = {}

    @property
    def spoils(self) -> bool:
        """Whether bytes may be lost or changed."""
        return bool(self.settings.loss or self.settings.corruption)

    def spoil(self, byte: int) -> int | None:
        """Pass one byte: itself, another one, or None if it is lost."""
        if self.settings.loss and self._random.random() < self.settings.loss:
            return None
        if self.settings.corruption and self._random.random() < self.settings.corruption:
            return byte ^ (1 << self._random.randrange(8))
        return byte

    def spoil_all(self, data: bytes) -> bytes:
        """Pass several bytes."""
        if not self.spoils:
            return data
        return bytes(b for b in (self.spoil(byte) for byte in data) if b is not None)

    def swallows(self, answer: bytes) -> bool:
        """Whether an answer of the board is lost as a whole."""
        return any(
            answer.startswith(start) and self._random.random() < share
            for start, share in self.unanswered.items()
        )

    def latency_ns(self) -> int:
        """The delay of the next chunk besides the wire."""
        settings = self.settings
        jitter_s = settings.jitter_s * self._random.random() if settings.jitter_s else 0.0
        return nanoseconds(settings.delay_s + jitter_s)

    def babble(self, size: int) -> bytes:
        """Bytes without meaning."""
        return self._random.randbytes(size)
