"""Faults that other clients and people cause: floods of a key, large samples, signals."""

from __future__ import annotations

import os
import signal
import time

from benchmarks.soak.children import ATTACHMENT_BYTES
from benchmarks.soak.course import BRAKE_S, Course
from benchmarks.soak.injections import engage
from benchmarks.soak.processes import Helper, memory_mb, stopped_by_signal
from benchmarks.soak.tail import is_stop

MEMORY_MB = 96.0
"""The most that a flood may add to the daemon's memory."""

STOPPING = (signal.SIGTSTP, signal.SIGTTOU)
ENDING = (
    *(signal.SIGQUIT, signal.SIGUSR1, signal.SIGUSR2, signal.SIGALRM),
    *(signal.SIGXCPU, signal.SIGVTALRM, signal.SIGIO),
)


def key_flood(course: Course) -> None:
    """Flood the e-stop's own key with requests to disengage, which are refused."""
    helper = Helper("flood", course.endpoint, "yahboomd/estop", "refusal")
    try:
        helper.wait_ready()
        for _ in range(3):
            course.move()
            time.sleep(0.3)
            if course.latched:
                course.unexpected(
                    "requests to disengage engage the e-stop", time.monotonic_ns() - 1_000_000_000
                )
            engage(course, course.kind)
            if not course.ready():
                return
    finally:
        helper.kill()


def attachments(course: Course) -> None:
    """Attach 15 MB to commands and to the e-stop, and 1 MB of parameters to queries."""
    pid = course.manager.life.pid
    before_mb, _ = memory_mb(pid, forget_peak=True)
    for key, kind in (("cmd_vel", "attachment"), ("yahboomd/board", "query")):
        course.move(0.3, 0.0)
        helper = Helper("flood", course.endpoint, key, kind)
        try:
            helper.wait_ready()
            time.sleep(1.0)
            engage(course, course.kind)
        finally:
            helper.kill()
        if not course.ready():
            return
    course.move(0.3, 0.0)
    large = os.urandom(ATTACHMENT_BYTES)
    engage(course, "e-stop with an attachment", attachment=large)
    if course.manager.life.pid != pid:
        # Another check judges the end of the daemon.
        return
    _, most_mb = memory_mb(pid)
    if most_mb - before_mb > MEMORY_MB:
        course.fail(f"memory grew from {before_mb:.0f} to {most_mb:.0f} MB")


def other_signal(course: Course) -> None:
    """Send a terminal's signal, or a rare one: the daemon stops first, then obeys."""
    course.move()
    number = course.random.choice([*STOPPING, *ENDING])
    life = course.manager.life
    since_ns = course.manager.signal(number)
    course.frame(course.kind, since_ns, wait_s=5.0)
    course.stands(since_ns, BRAKE_S + 0.1)
    if number in STOPPING:
        # In a process group without a shell the kernel ignores such a signal.
        course.wait(lambda: stopped_by_signal(life.pid), 0.5)
        course.manager.thaw()
        return
    name = signal.Signals(number).name
    if not course.wait(lambda: life.ended_ns is not None, 10.0) or life.ended_ns is None:
        course.unexpected(f"{name} does not end the daemon")
    elif (first := course.board.wire.first(since_ns, is_stop)) and first.t_ns > life.ended_ns:
        course.fail(f"{name} ended the daemon before it had stopped the wheels")
    elif life.status == 0:
        course.fail(f"{name} ended the daemon with status 0")
