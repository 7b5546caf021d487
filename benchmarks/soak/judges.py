"""Checks alarms, and the pose in motion, against the ground truth after a fault."""

from __future__ import annotations

import statistics
import time

from benchmarks.soak.course import NOISY, Course
from benchmarks.soak.motion import TWIST_SPAN_NS, Track, pose_excess_m, twist_excess_m_s
from benchmarks.soak.wheel_events import ALARMS, LATELY_NS, shown

STEADY_SHARE = 0.05
STEADY_M_S = 0.01

TRUTH_S = 1.0
"""The time to wait for the ground truth, which arrives in batches of 0.2 s."""


def alarms(course: Course, since_ns: int) -> None:
    """Verify that every event about a wheel is true."""
    for event in course.app.events_since(since_ns, *ALARMS):
        event_ns = event.stamp_ns - time.time_ns() + time.monotonic_ns()
        if not shown(event, course.board.truth.since(event_ns - LATELY_NS), event_ns):
            course.unexpected(f"no wheel did so: {event.message}", since_ns)
        elif course.kind in NOISY:
            course.ledger.notes[f"{course.kind}, and a wheel did so: {event.kind}"] += 1


def not_accused(course: Course, since_ns: int) -> None:
    """Verify that no event blames a wheel: each obeyed the speeds that the board received."""
    for event in course.app.events_since(since_ns, *ALARMS, "stop_not_obeyed", "off_speed"):
        if event.kind == "stop_not_obeyed" and event.wheel is None:
            # It reports that no reading came, which accuses no wheel.
            continue
        course.unexpected(f"healthy wheels are accused: {event.message}", since_ns)


def motion(course: Course, since_ns: int) -> None:
    """Verify that later poses and twists agree with the truth at their stamps."""
    now_ns = time.monotonic_ns()
    course.wait(lambda: course.board.truth.since(now_ns), TRUTH_S)
    truths = course.board.truth.since(since_ns - TWIST_SPAN_NS)
    track = Track(truths, time.time_ns() - time.monotonic_ns())
    if course.anchor is not None:
        excess_m = pose_excess_m(*course.anchor, course.app.poses_since(since_ns), track)
        if excess_m > 0.0:
            course.unexpected(
                f"a pose in motion is {excess_m * 1e3:.0f} mm further off than it may be", since_ns
            )
    excess_m_s = twist_excess_m_s(course.app.twists_since(since_ns), track)
    if excess_m_s > 0.0:
        course.unexpected(f"a twist is {excess_m_s:.2f} m/s further off than it may be", since_ns)


def steady_twist(course: Course, since_ns: int) -> None:
    """Verify that at a steady speed the median of the twists equals that of the truth."""
    twists = course.app.twists_since(since_ns)
    truths = course.board.truth.since(since_ns)
    if not twists or not truths:
        course.unexpected("no twist while it drives", since_ns)
        return
    measured = statistics.median(twist.vx for twist in twists)
    true = statistics.median(truth.vx for truth in truths)
    if abs(measured - true) > STEADY_SHARE * abs(true) + STEADY_M_S:
        course.unexpected(f"the twist is {measured:.3f} m/s at a true {true:.3f}", since_ns)
