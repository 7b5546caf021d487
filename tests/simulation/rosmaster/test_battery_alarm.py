from __future__ import annotations

import pytest

from yahboomd.simulation.rosmaster.battery_alarm import ALARM_AFTER, BatteryAlarm


@pytest.mark.parametrize(
    ("car_type", "volts", "latches"),
    [
        *((1, 9.59, True), (1, 9.6, False), (1, 13.09, False), (1, 13.1, True), (1, 8.55, False)),
        *((1, 6.49, True), (6, 8.6, True), (6, 8.59, False), (6, 6.5, False), (6, 6.49, True)),
    ],
)
def test_the_limits_are_those_of_the_car_in_tenths(
    car_type: int, volts: float, latches: bool
) -> None:
    alarm = BatteryAlarm()
    for _ in range(ALARM_AFTER):
        alarm.measure(volts, car_type)
    assert not alarm.latched
    alarm.measure(volts, car_type)
    assert alarm.latched == latches


def test_a_good_measurement_begins_the_two_seconds_again_and_two_cells_only_stop_them() -> None:
    alarm = BatteryAlarm()
    for _ in range(ALARM_AFTER):
        alarm.measure(9.0, 1)
    alarm.measure(7.0, 1)
    assert not alarm.latched
    alarm.measure(9.0, 1)
    assert alarm.latched
    other = BatteryAlarm()
    for volts in [9.0] * ALARM_AFTER + [10.0, 9.0]:
        other.measure(volts, 1)
    assert not other.latched


def test_it_keeps_the_voltage_that_latched_it() -> None:
    alarm = BatteryAlarm()
    assert alarm.tenths == 0
    for _ in range(ALARM_AFTER + 1):
        alarm.measure(9.19, 1)
    alarm.measure(11.0, 1)
    assert alarm.tenths == 91
