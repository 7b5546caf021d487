"""Wall stamps that never run backwards."""

from __future__ import annotations

from yahboomd.clock import Alarm
from yahboomd.daemon.stamps import WallStamps


class TwoClocks:
    monotonic = 1_000
    wall = 5_000_000

    def now_ns(self) -> int:
        return self.monotonic

    def wall_ns(self) -> int:
        return self.wall

    def alarm(self, callback: object) -> Alarm:
        raise NotImplementedError


def test_a_moment_keeps_its_distance_from_now() -> None:
    clock = TwoClocks()
    assert WallStamps(clock).of(400) == 5_000_000 - 600


def test_a_wall_clock_that_is_set_back_does_not_take_stamps_with_it() -> None:
    clock = TwoClocks()
    stamps = WallStamps(clock)
    first = stamps.of(1_000)
    clock.wall -= 1_000_000
    clock.monotonic += 20
    second = stamps.of(1_020)
    assert second == first + 1
    assert stamps.held_back == 1


def test_a_wall_clock_that_is_set_forward_is_followed() -> None:
    clock = TwoClocks()
    stamps = WallStamps(clock)
    stamps.of(1_000)
    clock.wall += 3_600_000_000_000
    assert stamps.of(1_000) == clock.wall


class HeldUpClock(TwoClocks):
    """A machine that runs somebody else between two readings."""

    held_up_ns = 0

    def wall_ns(self) -> int:
        before = self.monotonic
        self.monotonic += self.held_up_ns
        self.wall += self.held_up_ns
        return self.wall - (self.monotonic - before) // 2


def test_being_held_up_between_two_clocks_is_no_step_of_either() -> None:
    clock = HeldUpClock()
    stamps = WallStamps(clock)
    first = stamps.of(1_000)
    clock.held_up_ns = 300_000_000
    assert stamps.of(1_500) == first + 500
    clock.held_up_ns = 0
    assert stamps.of(2_000) == first + 1_000
    assert stamps.held_back == 0
