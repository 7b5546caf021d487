"""The alarm of the Rosmaster board's battery, which only a reset ends."""

from __future__ import annotations

from yahboomd.simulation.rosmaster.car_types import SUNRISE

ALARM_AFTER = 20
"""The bad measurements, one each 100 ms, after which the next one raises the alarm."""

LOW_V, HIGH_V = 9.6, 13.0
SUNRISE_V = (6.5, 8.5)
"""The limits of the car with two cells. For the others no alarm is raised in between."""


class BatteryAlarm:
    """The measured supply, and whether it was bad for two seconds.

    Attributes:
        tenths: The latest measurement in 0.1 V: 0 at first, frozen once the alarm is on.
        latched: The alarm is on.
    """

    def __init__(self) -> None:
        self.tenths = 0
        self.latched = False
        self._bad = 0

    def measure(self, volts: float, car_type: int) -> None:
        """Process a measurement; ignored once the alarm is on."""
        if self.latched:
            return
        self.tenths = int(volts * 10.0)
        cut_v = self.tenths / 10.0
        low_v, high_v = SUNRISE_V if car_type == SUNRISE else (LOW_V, HIGH_V)
        if low_v <= cut_v <= high_v:
            self._bad = 0
        elif not SUNRISE_V[0] <= cut_v <= SUNRISE_V[1]:
            self._bad += 1
            self.latched = self._bad > ALARM_AFTER
