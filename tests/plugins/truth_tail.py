"""Follows files of JSON lines: the ground truth, and the frames of the daemon."""

from __future__ import annotations

import itertools
import re
import struct
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import IO, Generic, TypeVar

import msgspec

from yahboomd.core.standstill import STANDING_M_S
from yahboomd.simulation.heard import HostBytes
from yahboomd.simulation.truth import TruthSample

KEEP_NS = 90_000_000_000
"""Older lines are discarded: no check needs them."""

SETTLED_NS = 50_000_000

Line = TypeVar("Line", TruthSample, HostBytes)


class Tail(Generic[Line]):
    """Follows a file.

    Args:
        path: The file; it need not exist yet.
        line: The type of each line.
    """

    def __init__(self, path: Path, line: type[Line]) -> None:
        self._path = path
        self._decoder: msgspec.json.Decoder[Line] = msgspec.json.Decoder(line)
        self._file: IO[bytes] | None = None
        self._rest = b""

    def news(self) -> list[Line]:
        """The complete lines since the last call."""
        if self._file is None:
            if not self._path.exists():
                return []
            self._file = self._path.open("rb")
        *lines, self._rest = (self._rest + self._file.read()).split(b"\n")
        return [self._decoder.decode(line) for line in lines]

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


class Truth:
    """The recent true poses of the robot."""

    def __init__(self, path: Path) -> None:
        self._tail = Tail(path, TruthSample)
        self.samples: deque[TruthSample] = deque()

    def look(self) -> None:
        """Read new lines."""
        self.samples.extend(self._tail.news())
        while self.samples and self.samples[-1].t_ns - self.samples[0].t_ns > KEEP_NS:
            self.samples.popleft()

    def since(self, t_ns: int) -> list[TruthSample]:
        """The samples from a moment on."""
        self.look()
        found = []
        for sample in reversed(self.samples):
            if sample.t_ns < t_ns:
                break
            found.append(sample)
        found.reverse()
        return found

    def stood_at(self, since_ns: int) -> int | None:
        """The moment from which all wheels stood, and went on standing, after a given one."""
        begun: int | None = None
        for sample in self.since(since_ns):
            if any(abs(speed) >= STANDING_M_S for speed in sample.speed_m_s):
                begun = None
            elif begun is None:
                begun = sample.t_ns
            elif sample.t_ns - begun >= SETTLED_NS:
                return begun
        return None

    def travelled_m(self, since_ns: int) -> float:
        """The longest way of any wheel from a moment on, counted in both directions."""
        samples = self.since(since_ns)
        return max(
            (
                sum(abs(b - a) for a, b in itertools.pairwise(way))
                for way in zip(*(sample.travel_m for sample in samples), strict=True)
            ),
            default=0.0,
        )

    def close(self) -> None:
        """Close the file."""
        self._tail.close()


class Order(msgspec.Struct, frozen=True, kw_only=True):
    """A speed commanded to the board.

    Attributes:
        t_ns: When its last byte was on the port.
        name: ``spd``, ``speed``, ``pwm``, ``motion`` or ``run``.
        largest: The largest of its numbers, unsigned.
    """

    t_ns: int
    name: str
    largest: int


_ORDER = re.compile(
    r"\$(spd|speed|pwm):(-?\d+,-?\d+,-?\d+,-?\d+)#"
    r"|\xff\xfc\x0a\x12\x01(.{6}).|\xff\xfc\x07\x11\x01\x00\x00\x00\x19",
    re.DOTALL,
)
_LONGEST = 64


class Wire:
    """The host's latest commands to the board."""

    def __init__(self, path: Path) -> None:
        self._tail = Tail(path, HostBytes)
        self._rest = ""
        self.orders: deque[Order] = deque()

    def look(self) -> None:
        """Read new lines."""
        for heard in self._tail.news():
            text = self._rest + heard.data
            end = 0
            for match in _ORDER.finditer(text):
                end = match.end()
                self.orders.append(_order(match, heard.t_ns))
            self._rest = text[end:][-_LONGEST:]
        while self.orders and self.orders[-1].t_ns - self.orders[0].t_ns > KEEP_NS:
            self.orders.popleft()

    def first(self, since_ns: int, wanted: Callable[[Order], bool]) -> Order | None:
        """The first order of a kind from a moment on."""
        self.look()
        return next(
            (order for order in self.orders if order.t_ns >= since_ns and wanted(order)), None
        )

    def close(self) -> None:
        """Close the file."""
        self._tail.close()


def _order(match: re.Match[str], t_ns: int) -> Order:
    if match[1]:
        numbers = [int(number) for number in match[2].split(",")]
        return Order(t_ns=t_ns, name=match[1], largest=max(map(abs, numbers)))
    if match[3] is None:
        return Order(t_ns=t_ns, name="run", largest=0)
    velocity = struct.unpack("<3h", match[3].encode("latin-1"))
    return Order(t_ns=t_ns, name="motion", largest=max(map(abs, velocity)))


def is_stop(order: Order) -> bool:
    """Whether it commands standstill."""
    return order.largest == 0
