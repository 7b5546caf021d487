from __future__ import annotations

import pytest

from benchmarks.soak.wheel_events import shown
from yahboomd.core.messages.native import EventSample
from yahboomd.simulation.truth import TruthSample

EVENT_NS = 1_000_000_000


def truth(*speeds: tuple[float, float], from_ns: int = EVENT_NS - 100_000_000) -> list[TruthSample]:
    return [
        TruthSample(
            t_ns=from_ns + n * 10_000_000,
            x=0.0,
            y=0.0,
            theta=0.0,
            vx=0.0,
            vy=0.0,
            wz=0.0,
            speed_m_s=pair,
            travel_m=(0.0, 0.0),
            ticks=(0, 0, 0, 0),
        )
        for n, pair in enumerate(speeds)
    ]


def event(kind: str, wish: float, seen: float, wheel: str | None = "left") -> EventSample:
    return EventSample(
        stamp_ns=1,
        kind=kind,
        severity="error",
        message="",
        wheel=wheel,
        data={"commanded_m_s": wish, "measured_m_s": seen},
    )


@pytest.mark.parametrize(
    ("kind", "wish", "seen", "left", "right", "expected"),
    [
        ("runaway_fast", 0.1, 0.9, 0.6, 0.1, True),
        ("runaway_fast", 0.1, 0.9, 0.12, 0.9, False),
        ("runaway_fast", -0.1, -0.9, -0.6, 0.0, True),
        ("runaway_fast", 0.0, 0.3, -0.6, 0.0, False),
        ("runaway_against", 0.2, -0.5, -0.1, 0.2, True),
        ("runaway_against", 0.2, -0.5, 0.2, 0.2, False),
        ("no_counts", 0.2, 0.0, 0.0, 0.2, True),
        ("no_counts", 0.2, 0.0, 0.2, 0.0, False),
    ],
)
def test_an_alarm_is_true_where_that_wheel_did_so(
    kind: str, wish: float, seen: float, left: float, right: float, expected: bool
) -> None:
    found = shown(event(kind, wish, seen), truth((wish, wish), (left, right)), EVENT_NS)
    assert found is expected


def test_what_came_after_an_alarm_does_not_make_it_true() -> None:
    later = truth((0.9, 0.9), from_ns=EVENT_NS + 1)
    assert not shown(event("runaway_fast", 0.1, 0.9), truth((0.1, 0.1)) + later, EVENT_NS)


def test_an_alarm_of_all_wheels_is_true_where_any_stood() -> None:
    assert shown(event("no_counts", 0.2, 0.0, wheel=None), truth((0.0, 0.2)), EVENT_NS)
