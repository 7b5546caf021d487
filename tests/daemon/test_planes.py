"""Planes beside the native one: each is handed what was published, and none can stop the rest."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from yahboomd.core.daemon.planes import Planes
from yahboomd.core.daemon.recorders import Recorders
from yahboomd.core.model import Event

SAMPLES = {
    "estimate": ("the estimate", 1),
    "imu": ("the sample", 2),
    "battery": (7.5, 3),
    "event": (Event(kind="estop", severity="warning", message="Stopped."), 4),
    "status": ("the status",),
}


class FakePlane:
    """Notes its calls; those that are named raise."""

    def __init__(self, name: str, *broken: str) -> None:
        self.name = name
        self.broken = broken
        self.calls: list[tuple[Any, ...]] = []

    def start(self, *arguments: Any) -> Any:
        *self.given, self.guarded = arguments
        self.take("start")
        return SimpleNamespace(
            **{name: lambda *sample, name=name: self.take(name, *sample) for name in SAMPLES}
        )

    def take(self, call: str, *sample: Any) -> None:
        self.calls.append((call, *sample))
        if call in self.broken:
            raise RuntimeError(call)


def started(*planes: FakePlane) -> tuple[Planes, Recorders]:
    recorders = Recorders()
    found = Planes(planes, recorders)
    found.start("bus", "config", "clock", "requests")  # type: ignore[arg-type]
    return found, recorders


def publish(planes: Planes) -> None:
    for name, sample in SAMPLES.items():
        getattr(planes, name)(*sample)


def test_every_plane_is_given_the_parts_of_the_daemon_and_all_that_is_published() -> None:
    one, other = FakePlane("one"), FakePlane("other")
    planes, recorders = started(one, other)
    publish(planes)
    for plane in (one, other):
        assert plane.given == ["bus", "config", "clock", "requests"]
        assert plane.calls == [("start",), *((name, *sample) for name, sample in SAMPLES.items())]
    assert recorders.failures == 0


def test_before_its_start_a_plane_is_given_nothing() -> None:
    plane = FakePlane("one")
    publish(Planes([plane], Recorders()))
    assert plane.calls == []


def test_a_plane_that_does_not_start_is_left_out_and_the_others_go_on() -> None:
    broken, whole = FakePlane("one", "start"), FakePlane("other")
    planes, recorders = started(broken, whole)
    publish(planes)
    assert broken.calls == [("start",)]
    assert len(whole.calls) == 1 + len(SAMPLES)
    assert recorders.status_values()["recorder_failures"] == 1
    assert "The start for one: RuntimeError" in recorders.status_values()["recorders_off"]


@pytest.mark.parametrize("call", SAMPLES)
def test_a_call_that_fails_is_switched_off_alone_and_reported_by_the_name_of_its_plane(
    call: str,
) -> None:
    broken, whole = FakePlane("one", call), FakePlane("other")
    planes, recorders = started(broken, whole)
    for _ in range(3):
        publish(planes)
    assert [each[0] for each in broken.calls].count(call) == 1
    assert len(broken.calls) == 1 + 3 * (len(SAMPLES) - 1) + 1
    assert len(whole.calls) == 1 + 3 * len(SAMPLES)
    assert recorders.failures == 1
    assert f"for one: RuntimeError: {call}" in recorders.status_values()["recorders_off"]


def test_a_guarded_callback_of_a_plane_returns_nothing_once_it_failed() -> None:
    plane = FakePlane("one", "answered")
    _, recorders = started(plane)
    answered = plane.guarded("The answers", plane.take)
    assert answered("answered") is None
    assert answered("well") is None
    assert plane.calls == [("start",), ("answered",)]
    assert "The answers for one: RuntimeError" in recorders.status_values()["recorders_off"]
