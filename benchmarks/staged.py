"""``yahboomd`` with stamps along a command's way: ``python -m benchmarks.staged FILE run ...``.

FILE gets, at the end, one line of JSON for each command whose frame was written: the moments, in
nanoseconds, at which each stage began, and at which the write was done. Some of the functions are
private, so :func:`spans` refuses figures that cannot be.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from yahboomd.cli.main import main
from yahboomd.core.bus.inbox import Inbox, SampleLane
from yahboomd.core.daemon.commands import CommandIntake
from yahboomd.core.daemon.control import Controller
from yahboomd.core.daemon.wheels import Wheels
from yahboomd.core.link.port import SerialPort
from yahboomd.core.link.writer import Writer

STAGES: dict[str, tuple[type, str]] = {
    "hop to the event loop": (SampleLane, "offer"),
    "unpacking of the sample": (Inbox, "_turn"),
    "decoding, and who may drive": (CommandIntake, "_take"),
    "control step: holds, limits, kinematics": (Controller, "_step"),
    "wheel speeds to a frame": (Wheels, "turn"),
    "outbox and line": (Writer, "velocity"),
    "write": (SerialPort, "write"),
}
"""The function whose call begins each stage."""

LONGEST_NS = 5_000_000


def install(path: Path) -> None:
    """Wrap the functions of the stages."""
    begun: dict[str, int] = {}
    first = next(iter(STAGES))

    def stamped(stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:  # noqa: ANN401 - whatever it is, it is passed on
            if stage == first:
                # The moments that beats passed in between do not belong to this command's way.
                begun.clear()
            begun[stage] = time.perf_counter_ns()
            result = function(*args, **kwargs)
            if stage == "write":
                done_ns = time.perf_counter_ns()
                if len(begun) == len(STAGES) and done_ns - begun[first] < LONGEST_NS:
                    with path.open("a") as file:
                        file.write(json.dumps([*(begun[each] for each in STAGES), done_ns]) + "\n")
                begun.clear()
            return result

        return call

    for stage, (owner, name) in STAGES.items():
        setattr(owner, name, stamped(stage, getattr(owner, name)))


def spans(moments: Sequence[Sequence[int]], sent: int, least: float = 0.5) -> list[list[int]]:
    """The time of each stage of each command, in nanoseconds.

    Args:
        moments: The lines of the file.
        sent: The number of commands that were sent meanwhile.
        least: The share of them that has to pass every stage in time.

    Raises:
        ValueError: A stage was passed by too few commands, or before the one that leads to it: the
            way of a command is another one by now, and ``STAGES`` has to follow it.
    """
    found = [[later - earlier for earlier, later in pairwise(each)] for each in moments]
    if len(found) < least * sent:
        raise ValueError(f"only {len(found)} of {sent} commands passed every stage")
    wrong = [stage for each in found for stage, span in zip(STAGES, each, strict=True) if span < 0]
    if wrong:
        raise ValueError(f"negative times: {', '.join(sorted(set(wrong)))} ({len(wrong)} in all)")
    return found


if __name__ == "__main__":
    install(Path(sys.argv[1]))
    sys.exit(main(sys.argv[2:]))
