"""Keys to velocities, with a deadman that a terminal allows. Pure; monotonic nanoseconds handed in.

A held key is seen as one press, a pause, and then repeats. So the first press counts until the
repeats must have begun; once they have, a short silence means that the key was let go.
"""

from __future__ import annotations

import msgspec

from yahboomd.cli.keyboard import Wish, direction, wish
from yahboomd.model import STANDSTILL, Twist2d

MS = 1_000_000

FIRST_NS = 700 * MS
"""How long a press counts. Terminals repeat a held key after 250 to 660 ms, as people set it."""

REPEATING_NS = 300 * MS
"""Presses of one key that follow each other closer than this come from a held key."""

SHORTEST_NS = 250 * MS
"""How long a repeat counts at least: a remote terminal hands several over at a time."""

ZEROS_NS = 300 * MS
"""How long zero is commanded after motion. Then nothing is: others may drive again."""

FASTER = 1.1
MIN_SCALE, MAX_SCALE = 0.05, 10.0


class TeleopView(msgspec.Struct, frozen=True, kw_only=True):
    """What is commanded, and the speeds that a key stands for.

    Attributes:
        twist: The command now; None while nothing is published.
        linear_m_s: Speed of the keys that go somewhere.
        angular_rad_s: Speed of the keys that turn.
    """

    twist: Twist2d | None
    linear_m_s: float
    angular_rad_s: float


class Teleop:
    """One keyboard that drives.

    Args:
        linear_m_s: Speed to begin with.
        angular_rad_s: Turning speed to begin with.
    """

    def __init__(self, *, linear_m_s: float, angular_rad_s: float) -> None:
        self._linear_m_s = linear_m_s
        self._angular_rad_s = angular_rad_s
        self._scale = 1.0
        self._key: str | None = None
        self._pressed_ns = 0
        self._until_ns = 0
        self._zero_until_ns: int | None = None

    def press(self, key: str, now_ns: int) -> Wish:
        """A key came.

        Returns:
            What it asks for; ``move``, ``stop``, ``faster`` and ``slower`` are done already, and
            what remains to be done has stopped the motion too.
        """
        wanted = wish(key)
        if wanted == "move":
            self._hold(key, now_ns)
        elif wanted in {"faster", "slower"}:
            factor = FASTER if wanted == "faster" else 1.0 / FASTER
            self._scale = min(max(self._scale * factor, MIN_SCALE), MAX_SCALE)
        else:
            self.stop(now_ns)
        return wanted

    def stop(self, now_ns: int) -> None:
        """Command zero, for a moment."""
        self._key = None
        self._zero_until_ns = now_ns + ZEROS_NS

    def command(self, now_ns: int) -> Twist2d | None:
        """The velocity to publish at this moment; None for none."""
        if self._key is not None and now_ns >= self._until_ns:
            self.stop(now_ns)
        if self._key is not None:
            return self._twist(self._key)
        if self._zero_until_ns is None or now_ns >= self._zero_until_ns:
            self._zero_until_ns = None
            return None
        return STANDSTILL

    def view(self, now_ns: int) -> TeleopView:
        """What there is to show."""
        return TeleopView(
            twist=self.command(now_ns),
            linear_m_s=self._linear_m_s * self._scale,
            angular_rad_s=self._angular_rad_s * self._scale,
        )

    def _hold(self, key: str, now_ns: int) -> None:
        gap_ns = now_ns - self._pressed_ns
        repeats = self._key == key and gap_ns < REPEATING_NS
        self._until_ns = now_ns + (max(SHORTEST_NS, 3 * gap_ns) if repeats else FIRST_NS)
        self._key, self._pressed_ns = key, now_ns

    def _twist(self, key: str) -> Twist2d:
        vx, vy, wz = direction(key) or (0, 0, 0)
        linear, angular = self._linear_m_s * self._scale, self._angular_rad_s * self._scale
        return Twist2d(vx=vx * linear, vy=vy * linear, wz=wz * angular)
