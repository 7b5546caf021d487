"""The time that threads were ready to run and had no processor, by the kernel's count.

A process that sleeps most of its time is woken at once even where those that work have to wait, so
a stall that it sees is a stall of the machine, but not the other way round. The kernel counts for
every thread how long it waited in a run queue (``/proc/PID/task/TID/schedstat``, the second number,
in nanoseconds). A thread that the kernel itself holds (state D: a read of a pty waits for a
worker of the kernel's, which has to get a processor, too) is in no run queue; that is sampled.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from pathlib import Path

SAMPLE_S = 0.02
KEEP = 5_000
LATEST_S = 0.2

Sample = tuple[int, dict[str, int]]


class Waiting:
    """Samples the waits of the threads of some processes.

    Args:
        processes: Returns their ids; called at every sample.
    """

    def __init__(self, processes: Callable[[], Iterable[int]]) -> None:
        self._processes = processes
        self._samples: deque[Sample] = deque(maxlen=KEEP)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def within_s(self, since_ns: int, until_ns: int) -> float:
        """The longest wait of any thread in a stretch of time.

        The stretch is widened to the samples around it.
        """
        deadline = time.monotonic() + LATEST_S
        while (not self._samples or self._samples[-1][0] < until_ns) and (
            time.monotonic() < deadline
        ):
            time.sleep(SAMPLE_S / 4)
        return longest_wait_ns(list(self._samples), since_ns, until_ns) / 1e9

    def _run(self) -> None:
        held: Counter[str] = Counter()
        before_ns = time.monotonic_ns()
        while not self._ending.wait(SAMPLE_S):
            processes = list(self._processes())
            now_ns = time.monotonic_ns()
            for thread in held_by_the_kernel(processes):
                held[thread] += now_ns - before_ns
            before_ns = now_ns
            waits = waits_ns(processes)
            self._samples.append((now_ns, {each: ns + held[each] for each, ns in waits.items()}))

    def close(self) -> None:
        """End it."""
        self._ending.set()
        self._thread.join()


def waits_ns(processes: Iterable[int]) -> dict[str, int]:
    """The time that every thread of some processes has waited until now."""
    found: dict[str, int] = {}
    for process in processes:
        with contextlib.suppress(OSError):
            for thread in Path(f"/proc/{process}/task").iterdir():
                with contextlib.suppress(OSError, IndexError, ValueError):
                    found[thread.name] = int((thread / "schedstat").read_text().split()[1])
    return found


def held_by_the_kernel(processes: Iterable[int]) -> list[str]:
    """The threads that the kernel holds now, in an uninterruptible sleep."""
    found: list[str] = []
    for process in processes:
        with contextlib.suppress(OSError):
            for thread in Path(f"/proc/{process}/task").iterdir():
                with contextlib.suppress(OSError, IndexError):
                    # The name, in brackets, may contain anything.
                    state = (thread / "stat").read_text().rpartition(")")[2].split()[0]
                    if state == "D":
                        found.append(thread.name)
    return found


def longest_wait_ns(samples: list[Sample], since_ns: int, until_ns: int) -> int:
    """The largest growth of any thread's wait from before a moment to after another."""
    before = [waits for at_ns, waits in samples if at_ns <= since_ns]
    after = [waits for at_ns, waits in samples if at_ns >= until_ns]
    first = before[-1] if before else samples[0][1] if samples else {}
    last = after[0] if after else samples[-1][1] if samples else {}
    return max((waited - first.get(thread, waited) for thread, waited in last.items()), default=0)
