"""Turns keys into velocities, with a deadman for terminals. Pure; monotonic times are arguments.

A terminal reports no releases. A held key is one press, a pause, and then repeats. So the first
press counts until the repeats must have begun. Once they have begun, a short silence means that the
key was released.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

from yahboomd.core.model import FASTEST_M_S, FASTEST_RAD_S, Twist2d

Wish: TypeAlias = Literal["move", "stop", "faster", "slower", "estop", "release", "quit"]

MOVES: dict[str, tuple[int, int, int]] = {
    **dict.fromkeys(("up", "w", "i"), (1, 0, 0)),
    **dict.fromkeys(("down", "s", ","), (-1, 0, 0)),
    **dict.fromkeys(("left", "a", "j"), (0, 0, 1)),
    **dict.fromkeys(("right", "d", "l"), (0, 0, -1)),
    "u": (1, 0, 1),
    "o": (1, 0, -1),
    "m": (-1, 0, -1),
    ".": (-1, 0, 1),
    # As in ROS's keyboard teleoperation: shift, for bases that can move sideways.
    "J": (0, 1, 0),
    "L": (0, -1, 0),
}
"""The keys that move, with the signs of vx, vy and wz."""

_WISHES: dict[str, Wish] = {
    **dict.fromkeys("+=", "faster"),
    **dict.fromkeys("-_", "slower"),
    **dict.fromkeys("eE", "estop"),
    **dict.fromkeys("rR", "release"),
    # Ctrl-C and Ctrl-D too, if the terminal passes them on.
    **dict.fromkeys("qQ\x03\x04", "quit"),
}


def direction(key: str) -> tuple[int, int, int] | None:
    """The direction in which a key moves the base; None for other keys."""
    # With caps lock on, W is still forward.
    return MOVES.get(key) or MOVES.get(key.lower())


def wish(key: str) -> Wish:
    """The meaning of a key. An unknown key stops."""
    if direction(key) is not None:
        return "move"
    return _WISHES.get(key, "stop")


MS = 1_000_000

FIRST_NS = 700 * MS
"""The time for which a press counts. Terminals repeat a held key after 250 to 660 ms."""

REPEATING_NS = 300 * MS
"""Presses of one key that follow each other closer than this come from a held key."""

SHORTEST_NS = 250 * MS
"""The least time for which a repeat counts, because a remote terminal sends several at a time."""

FASTER = 1.1
MIN_SCALE, MAX_SCALE = 0.05, 10.0


class Teleop:
    """Turns the keys of one keyboard into motion."""

    def __init__(self, *, linear_m_s: float, angular_rad_s: float) -> None:
        self._linear_m_s = linear_m_s
        self._angular_rad_s = angular_rad_s
        self._scale = 1.0
        self._key: str | None = None
        self._pressed_ns = 0
        self._until_ns = 0

    def press(self, key: str, now_ns: int) -> Wish:
        """Take a key.

        Returns:
            Its meaning. ``move``, ``stop``, ``faster`` and ``slower`` are done already; the others
            have stopped the motion, and the caller does the rest.
        """
        wanted = wish(key)
        if wanted == "move":
            self._hold(key, now_ns)
        elif wanted in {"faster", "slower"}:
            factor = FASTER if wanted == "faster" else 1.0 / FASTER
            self._scale = min(max(self._scale * factor, MIN_SCALE), MAX_SCALE)
        else:
            self._key = None
        return wanted

    def motion(self, now_ns: int) -> tuple[Twist2d, int] | None:
        """The velocity of the held key, and when it ends without a repeat; None if no key is."""
        if self._key is None or now_ns >= self._until_ns:
            return None
        return self._twist(self._key), self._until_ns

    @property
    def linear_m_s(self) -> float:
        """The speed of keys that drive."""
        return min(self._linear_m_s * self._scale, FASTEST_M_S)

    @property
    def angular_rad_s(self) -> float:
        """The speed of keys that turn."""
        return min(self._angular_rad_s * self._scale, FASTEST_RAD_S)

    def _hold(self, key: str, now_ns: int) -> None:
        gap_ns = now_ns - self._pressed_ns
        repeats = self._key == key and gap_ns < REPEATING_NS
        self._until_ns = now_ns + (max(SHORTEST_NS, 3 * gap_ns) if repeats else FIRST_NS)
        self._key, self._pressed_ns = key, now_ns

    def _twist(self, key: str) -> Twist2d:
        vx, vy, wz = direction(key) or (0, 0, 0)
        linear_m_s = self.linear_m_s
        return Twist2d(vx=vx * linear_m_s, vy=vy * linear_m_s, wz=wz * self.angular_rad_s)
