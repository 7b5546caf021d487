from __future__ import annotations

import os
import threading

from benchmarks.soak.waiting import Waiting, held_by_the_kernel, longest_wait_ns, waits_ns

SAMPLES = [
    (0, {"1": 100, "2": 0}),
    (20, {"1": 100, "2": 5}),
    (40, {"1": 130, "2": 6, "3": 900}),
    (60, {"1": 131, "2": 80, "3": 900}),
]


def test_the_wait_is_that_of_the_thread_that_waited_longest_in_the_samples_around() -> None:
    assert longest_wait_ns(SAMPLES, 25, 39) == 30
    assert longest_wait_ns(SAMPLES, 41, 59) == 74
    assert longest_wait_ns(SAMPLES, 0, 60) == 80


def test_a_thread_that_began_in_between_did_not_wait_before_it_was() -> None:
    assert longest_wait_ns(SAMPLES, 20, 40) == 30


def test_nothing_was_waited_for_where_nothing_was_seen() -> None:
    assert longest_wait_ns([], 0, 10) == 0


def test_every_thread_of_this_process_is_seen_and_one_that_is_gone_does_no_harm() -> None:
    found = waits_ns([os.getpid(), 2**22 + 1])
    assert str(threading.get_native_id()) in found
    assert min(found.values()) >= 0


def test_a_stretch_that_has_just_ended_is_reported_at_once() -> None:
    waiting = Waiting(lambda: [os.getpid()])
    try:
        assert waiting.within_s(0, 1) >= 0.0
    finally:
        waiting.close()


def test_a_process_that_sleeps_or_runs_is_not_held_by_the_kernel() -> None:
    assert held_by_the_kernel([os.getpid(), 2**22 + 1]) == []
