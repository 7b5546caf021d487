"""``yahboomd`` with a sampler in its main thread: ``python -m benchmarks.sampled FILE run ...``.

After every few milliseconds of CPU time that the process has used, the kernel interrupts it and the
stack of the event loop's thread is noted. FILE gets, at the end, one line for each stack: functions
from the outermost to the innermost, separated by ``;``, and how often it was met.
"""

from __future__ import annotations

import atexit
import signal
import sys
from collections import Counter
from pathlib import Path
from types import FrameType

from yahboomd.cli.main import main

EVERY_S = 0.001


def name_of(frame: FrameType) -> str:
    """Module and function, such as ``yahboomd.core.link.writer:Writer._pump``."""
    module = frame.f_globals.get("__name__", "?")
    return f"{module}:{frame.f_code.co_qualname}"


def install(path: Path) -> None:
    """Start to sample."""
    stacks: Counter[str] = Counter()

    def sample(_number: int, frame: FrameType | None) -> None:
        names: list[str] = []
        while frame is not None:
            names.append(name_of(frame))
            frame = frame.f_back
        stacks[";".join(reversed(names))] += 1

    def write() -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        path.write_text("".join(f"{stack} {count}\n" for stack, count in stacks.items()))

    atexit.register(write)
    signal.signal(signal.SIGPROF, sample)
    signal.setitimer(signal.ITIMER_PROF, EVERY_S, EVERY_S)


if __name__ == "__main__":
    install(Path(sys.argv[1]))
    sys.exit(main(sys.argv[2:]))
