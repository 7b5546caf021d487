"""Faults of time: a frozen daemon, delayed bytes, answers that never come."""

from __future__ import annotations

import signal
import time

from benchmarks.soak import judges
from benchmarks.soak.course import BRAKE_S, Course
from benchmarks.soak.injections import RAMP_S, TIMEOUT_S, engage
from benchmarks.soak.processes import WATCHDOG_S
from benchmarks.soak.tail import Order, is_stop
from yahboomd.core.model import STANDING_M_S

EX_TEMPFAIL = 75
"""The daemon's exit code if standstill was not confirmed."""

NOTICE_S = 2.0
"""The time in which the odometry must notice another tick."""

BACKED_M = 0.01
"""The backward travel that brakes may give a wheel."""

QUEUE_S = 0.4
"""The time on the wire of the bytes that queued during a stall."""


def frozen(course: Course) -> None:
    """Freeze the daemon's process for less than the watchdog's time."""
    for_s = course.random.uniform(0.3, 1.9)
    _freeze(course, for_s, reverses=for_s > TIMEOUT_S + 0.2 and course.random.random() < 0.5)


def frozen_full(course: Course) -> None:
    """Freeze it until the kernel's buffer is full, so that later lines are lost."""
    _freeze(course, course.random.uniform(1.2, 1.9), reverses=False)


def _freeze(course: Course, for_s: float, *, reverses: bool) -> None:
    course.move(0.3, 0.0)
    life = course.manager.life
    frozen_ns = course.manager.freeze()
    try:
        if reverses:
            course.app.steady(-0.3)
            time.sleep(for_s - 0.2)
            course.app.silent()
            time.sleep(0.2)
        else:
            time.sleep(for_s)
    finally:
        thawed_ns = course.manager.thaw()
    if reverses:
        _nothing_old(course, thawed_ns)
    else:
        time.sleep(1.0)
    if life.ended_ns is not None and for_s > WATCHDOG_S / 2:
        # Only if the machine ran neither the daemon nor the soak in time.
        life.asked = True
        course.ledger.notes[f"{course.kind}: the watchdog ended it"] += 1
        return
    judges.not_accused(course, frozen_ns)
    judges.motion(course, frozen_ns)


def _nothing_old(course: Course, thawed_ns: int) -> None:
    """Verify that commands which waited in a frozen daemon move nothing."""
    before = course.board.wire.last_before(thawed_ns)
    most = before.largest if before is not None else 0
    course.frame(
        "frozen process: from its thaw", thawed_ns, lambda order: order.largest < most, wait_s=5.0
    )
    course.stands(thawed_ns, RAMP_S + BRAKE_S + 0.1)
    backed_m = course.board.truth.backed_m(thawed_ns)
    if backed_m > BACKED_M:
        course.unexpected(
            f"commands that had waited moved the wheels back by {backed_m:.3f} m", thawed_ns
        )


def burst(course: Course) -> None:
    """Hold the board's lines back and deliver them at once, again and again."""
    since_ns = time.monotonic_ns()
    course.app.wander()
    for _ in range(3):
        for_s = course.random.uniform(0.1, 0.9)
        course.board.do(f"hold {for_s:.3f}")
        time.sleep(for_s + course.random.uniform(0.3, 1.0))
    judges.not_accused(course, since_ns)
    judges.motion(course, since_ns)


def another_tick(course: Course) -> None:
    """Change the period in which the board renews its totals, as other firmware does."""
    since_ns = time.monotonic_ns()
    course.move(0.3, 0.0)
    course.board.do(f"tick-period {course.random.choice([0.005, 0.02, 0.0])}")
    time.sleep(NOTICE_S)
    settled_ns = time.monotonic_ns()
    time.sleep(3.0)
    judges.not_accused(course, since_ns)
    judges.motion(course, settled_ns)
    judges.steady_twist(course, settled_ns)
    course.stands(course.app.silent(), TIMEOUT_S + RAMP_S + BRAKE_S)
    course.board.do("tick-period 0.01")
    time.sleep(NOTICE_S)


def lost_answers(course: Course) -> None:
    """Leave a question of the daemon unanswered; commands still reach the board."""
    course.move(0.2, 0.0, for_s=0.3)
    since_ns = time.monotonic_ns()
    course.board.do("unanswered $Battery 1" if course.streamed else "unanswered $data 0.3")
    # The battery is asked for every five seconds.
    for number in range(60):
        _changes(course, 0.3 if number % 2 == 0 else 0.2)
    course.board.do("clear")
    judges.not_accused(course, since_ns)
    judges.motion(course, since_ns)
    course.stands(course.app.silent(), TIMEOUT_S + RAMP_S + BRAKE_S)


def _changes(course: Course, vx: float) -> None:
    """Measure the time until another speed reaches the board."""
    before = course.board.wire.last_before(time.monotonic_ns())
    speed = before.largest if before is not None else 0
    sent_ns = course.app.now(vx)

    def another(order: Order) -> bool:
        return order.largest != speed

    course.frame("a speed, while answers are lost", sent_ns, another, wait_s=2.0)
    time.sleep(course.random.uniform(0.05, 0.2))


def output_stall(course: Course) -> None:
    """Stall the port's output for a while; everything queued then goes out at once."""
    course.app.wander()
    for_s = course.random.uniform(0.1, 2.0)
    since_ns = course.board.do(f"stall {for_s:.3f}")
    time.sleep(for_s + 1.0)
    judges.motion(course, since_ns)
    course.stands(course.app.silent(), TIMEOUT_S + RAMP_S + BRAKE_S)


def estop_in_output_stall(course: Course) -> None:
    """Engage the e-stop while the port takes no output."""
    course.move()
    for_s = course.random.uniform(0.3, 2.0)
    ends_ns = course.board.stall(for_s)
    time.sleep(course.random.uniform(0.0, 0.7 * for_s))
    engage(course, course.kind, taken_ns=ends_ns, within_s=BRAKE_S + QUEUE_S)


def sigterm_in_output_stall(course: Course) -> None:
    """Stop the service while the port takes no output: status 0 only if the wheels stand."""
    course.move()
    life = course.manager.life
    stops = len(course.manager.stop_statuses)
    for_s = course.random.uniform(0.5, 2.0)
    ends_ns = course.board.stall(for_s)
    time.sleep(course.random.uniform(0.05, 0.3))
    course.manager.signal(signal.SIGTERM)
    # The next daemon must not drive at once.
    course.app.silent()
    if not course.wait(lambda: life.status is not None, 15.0) or life.ended_ns is None:
        course.unexpected("the daemon does not end")
        return
    course.frame(course.kind, ends_ns, is_stop, wait_s=10.0)
    course.stands(ends_ns, 1.0 + BRAKE_S + QUEUE_S)
    if life.status == 0:
        speed = course.board.truth.fastest_m_s(life.ended_ns - 20_000_000, life.ended_ns)
        if speed > STANDING_M_S:
            course.fail(f"the daemon ended with 0 while wheels turned at {speed:.2f} m/s")
    elif life.status != EX_TEMPFAIL:
        course.fail(f"the daemon ended with {life.status}")
    elif not course.wait(lambda: len(course.manager.stop_statuses) > stops, 10.0):
        course.unexpected("the manager did not stop the wheels after a daemon that could not")
