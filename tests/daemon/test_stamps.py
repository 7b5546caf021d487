"""Wall stamps run backwards only if the clock was set."""

from __future__ import annotations

import itertools

import pytest

from yahboomd.core.clock import Alarm
from yahboomd.core.daemon.stamps import WallStamps
from yahboomd.core.model import Event

MS = 1_000_000
S = 1000 * MS


class TwoClocks:
    monotonic = 100 * S
    wall = 1_700_000_000 * S
    suspended = 0

    def now_ns(self) -> int:
        return self.monotonic

    def wall_ns(self) -> int:
        return self.wall

    def suspended_ns(self) -> int:
        return self.suspended

    def alarm(self, callback: object) -> Alarm:
        raise NotImplementedError

    def run(self, ns: int) -> None:
        self.monotonic += ns
        self.wall += ns


class Scene:
    def __init__(self, clock: TwoClocks | None = None) -> None:
        self.clock = clock or TwoClocks()
        self.events: list[Event] = []
        self.stamps = WallStamps(self.clock, self.events.append)
        self.stamps.of(self.clock.monotonic)

    def readings(self, count: int, period_ns: int = 10 * MS) -> list[int]:
        """The stamps of readings that are taken 5 ms before they are published."""
        found = []
        for _ in range(count):
            self.clock.run(period_ns)
            found.append(self.stamps.of(self.clock.monotonic - 5 * MS))
        return found


def test_a_moment_keeps_its_distance_from_now() -> None:
    scene = Scene()
    scene.clock.run(10 * MS)
    assert scene.stamps.of(scene.clock.monotonic - 400) == scene.clock.wall - 400


@pytest.mark.parametrize("by_s", [1.0, 60.0, 7200.0])
def test_a_clock_that_is_set_back_is_followed_at_once_and_said_so_once(by_s: float) -> None:
    scene = Scene()
    scene.readings(10)
    scene.clock.wall -= round(by_s * S)
    after = scene.readings(1000)
    assert after[0] == scene.clock.wall - 9990 * MS - 5 * MS
    assert {b - a for a, b in itertools.pairwise(after)} == {10 * MS}
    (event,) = scene.events
    assert (event.kind, event.severity, event.data) == ("clock_stepped", "warning", {"by_s": -by_s})
    assert f"set back by {by_s:.1f} s" in event.message
    assert (scene.stamps.steps, scene.stamps.held_back) == (1, 0)


@pytest.mark.parametrize("by_ms", [1, 20, 999])
def test_a_clock_that_is_set_back_by_less_is_followed_in_order(by_ms: int) -> None:
    scene = Scene()
    scene.readings(10)
    scene.clock.wall -= by_ms * MS
    after = scene.readings(2000)
    assert min(b - a for a, b in itertools.pairwise(after)) >= 9 * MS
    assert after[-1] == scene.clock.wall - 5 * MS
    assert scene.events == []
    assert scene.stamps.held_back == 0


def test_a_clock_that_is_slowed_down_leaves_the_stamps_in_order_and_right() -> None:
    scene = Scene()
    for _ in range(1000):
        scene.clock.wall -= 5_000
        (stamp_ns,) = scene.readings(1)
        assert stamp_ns == scene.clock.wall - 5 * MS


@pytest.mark.parametrize(("by_s", "events"), [(0.5, 0), (3600.0, 1)])
def test_a_clock_that_is_set_forward_is_followed_at_once(by_s: float, events: int) -> None:
    scene = Scene()
    scene.readings(10)
    scene.clock.wall += round(by_s * S)
    assert scene.readings(1) == [scene.clock.wall - 5 * MS]
    assert [event.severity for event in scene.events] == ["info"] * events


def test_a_step_is_noticed_without_any_reading() -> None:
    scene = Scene()
    scene.clock.wall -= 7200 * S
    scene.stamps.follow()
    assert len(scene.events) == 1
    scene.stamps.follow()
    scene.readings(10)
    assert len(scene.events) == 1


def test_a_suspend_is_no_step_of_the_clock() -> None:
    scene = Scene()
    scene.clock.wall += 3600 * S
    scene.clock.suspended += 3600 * S
    assert scene.readings(1) == [scene.clock.wall - 5 * MS]
    assert scene.events == []


class HeldUpClock(TwoClocks):
    """A machine that runs something else between two readings."""

    held_up_ns = 0

    def wall_ns(self) -> int:
        before = self.monotonic
        self.run(self.held_up_ns)
        return self.wall - (self.monotonic - before) // 2


def test_being_held_up_between_two_clocks_is_no_step_of_either() -> None:
    clock = HeldUpClock()
    scene = Scene(clock)
    begin_ns = clock.monotonic
    first = scene.stamps.of(begin_ns + 500)
    clock.held_up_ns = 3 * S
    assert scene.stamps.of(begin_ns + 1000) == first + 500
    clock.held_up_ns = 0
    assert scene.stamps.of(begin_ns + 1500) == first + 1000
    assert scene.events == []
    assert scene.stamps.held_back == 0
