"""The law by which a board's speed loop winds up on a wheel that stands.

Both vendors' firmwares have the same incremental loop. Every 10 ms the errors of a wheel without
counts add ``I·v``, and a new setpoint adds ``P`` times its change. So the output above the dead
zone is ``P·v + I·way/10 ms``, up to the rest of full output: with the gains as sold a third of a
metre, 2.6 s at 0.12 m/s and 16 s at 0.02 m/s.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

FULL_OUTPUT = 3600
MOST_OF_THE_LOOP = 2000
"""PWM units; the loop's own limit is below full output if the dead zone is small."""

LEAST_REACH, LOOP_S = 200, 0.01
AS_SOLD = (0.8, 0.06, 0.5)
"""P, I and D."""

SLOWEST_I = 0.01
"""A smaller gain was garbled, or makes a robot that nobody can drive."""

UNKNOWN_TIMES = 4.0
"""A board that stores no gains is taken for one with quick ones, for safety."""

DEAD_ZONE, SUNRISE, SUNRISE_ZONE = 1600, 6, 2000
"""A board that stores no dead zone adds 1600; a Rosmaster set to car type 6, Sunrise, adds 2000."""


class LoopLaw(msgspec.Struct, frozen=True, kw_only=True):
    """The output of the loop as a share of its own range.

    Attributes:
        per_m_s: For each m/s of the setpoint.
        per_m: For each metre of commanded way without a count.
        dead_zone: Whether the board stores one, which `yahboomd tune` can correct.
    """

    per_m_s: float
    per_m: float
    dead_zone: bool

    def output(self, way_m: float, speed_m_s: float) -> float:
        """The share of its range, not limited to 1, after this commanded way at this setpoint."""
        return self.per_m * abs(way_m) + self.per_m_s * abs(speed_m_s)


def loop_law(settings: Mapping[str, object] | None) -> LoopLaw:
    """The law of a board by its stored settings; None if it shows none."""
    known, times = settings or {}, UNKNOWN_TIMES if settings is None else 1.0
    gains, zone = known.get("pid"), known.get("dead_zone")
    p, i, _ = gains if isinstance(gains, tuple) else AS_SOLD
    fixed = SUNRISE_ZONE if known.get("car_type") == SUNRISE else DEAD_ZONE
    reach = FULL_OUTPUT - (zone if isinstance(zone, int) else fixed)
    share = times * 1000.0 / max(LEAST_REACH, min(MOST_OF_THE_LOOP, reach))
    per_m = share * max(i, SLOWEST_I) / LOOP_S
    return LoopLaw(per_m_s=share * p, per_m=per_m, dead_zone=zone is not None)


UNKNOWN_LAW = loop_law(None)
