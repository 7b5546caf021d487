from __future__ import annotations

import pytest

from yahboomd.core.drive.battery import BatteryWatch
from yahboomd.core.model import Event

S = 1_000_000_000


def rest(watch: BatteryWatch, *volts: float, begin_s: int = 0, every_s: int = 5) -> list[Event]:
    """Readings at rest; the events that follow from them."""
    events = [
        watch.read(each, (begin_s + every_s * number) * S) for number, each in enumerate(volts)
    ]
    return [each for each in events if each is not None]


def test_a_battery_is_judged_by_the_median_of_30_s_at_rest() -> None:
    watch = BatteryWatch(10.5)
    assert rest(watch, 10.0, 10.0, 12.0, 10.0, 10.0, 10.0) == []
    assert watch.level == ""
    (event,) = rest(watch, 12.0, begin_s=30)
    assert (event.kind, event.severity, watch.level) == ("battery_low", "warning", "low")
    assert "10.0 V at rest" in event.message


def test_a_reading_of_30_s_ago_still_counts() -> None:
    watch = BatteryWatch(10.5)
    rest(watch, 12.0, 12.0, 10.0, 10.0, every_s=10)
    assert watch.median_v == 11.0


def test_readings_in_motion_and_while_the_voltage_recovers_do_not_count() -> None:
    watch = BatteryWatch(10.5)
    rest(watch, 12.0, 12.0, 12.0)
    for second in range(11, 200):
        watch.moves(second * S)
        assert watch.read(4.5, second * S) is None
    assert watch.read(4.5, 201 * S) is None
    rest(watch, *[12.0] * 6, begin_s=202)
    assert watch.level == "good"


def test_short_rests_add_up() -> None:
    watch = BatteryWatch(10.5)
    for trip in range(10):
        watch.moves(20 * trip * S)
        rest(watch, 10.0, 10.0, begin_s=20 * trip + 7, every_s=5)
    assert watch.level == "low"


def test_a_voltage_around_a_limit_warns_once() -> None:
    watch = BatteryWatch(10.5, 9.6)
    wavers = [10.4 if number // 8 % 2 else 10.6 for number in range(200)]
    assert [event.kind for event in rest(watch, *wavers)] == ["battery_low"]
    events = rest(watch, *[9.5] * 8, *[9.7] * 8, *[10.0] * 8, *[12.0] * 8, begin_s=2000)
    assert [event.kind for event in events] == ["battery_empty", "battery_low", "battery_good"]


def test_no_reading_is_no_low_battery() -> None:
    watch = BatteryWatch(10.5, 9.6)
    rest(watch, 9.0, 9.0)
    assert watch.level == ""
    # Switched off, or being exchanged.
    assert rest(watch, *[0.2] * 50, begin_s=10) == []
    watch.forget()
    assert rest(watch, *[12.4] * 20, begin_s=300) == []
    assert watch.level == "good"


def test_without_a_limit_nothing_is_judged() -> None:
    watch = BatteryWatch()
    assert rest(watch, *[4.5] * 20) == []
    assert watch.level == ""


@pytest.mark.parametrize("every_s", [1, 60])
def test_rare_and_frequent_readings_are_enough(every_s: int) -> None:
    watch = BatteryWatch(10.5)
    rest(watch, *[10.0] * 31, every_s=every_s)
    assert watch.level == "low"


def test_an_empty_battery_refuses_programs_and_no_person() -> None:
    watch = BatteryWatch(stop_v=9.6)
    assert watch.refuses("cmd_vel", ("keyboard",)) == ""
    rest(watch, *[9.0] * 8)
    assert "board.battery_stop_v = 9.6" in watch.refuses("cmd_vel", ("keyboard",))
    assert watch.refuses("keyboard", ("keyboard",)) == ""
