"""Runs ``yahboomd run`` with recorders that fail once each, after a file appears.

    python -m benchmarks.soak.failing_daemon FILE run ...

Only the soak uses it. The exceptions are those of a full disk and of a mistake in a recorder.
"""

from __future__ import annotations

import errno
import itertools
import os
import re
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from yahboomd.cli.main import main
from yahboomd.core.daemon.recorders import Recorders

SPARED = re.compile(r"The (pose|events) on the bus|The status(?! for)")
"""The soak needs these, so they do not fail."""

ERRORS: tuple[BaseException, ...] = (
    OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
    OverflowError("float too large to pack with f format"),
    MemoryError(),
)


class Fuse:
    """Decides which call of a recorder raises."""

    def __init__(self, path: str) -> None:
        self._path = path
        self._lit = False
        self._failed: set[str] = set()
        self._errors = itertools.cycle(ERRORS)
        threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while not os.path.exists(self._path):
            time.sleep(0.1)
        self._lit = True

    def burn(self, name: str) -> None:
        """Raise, unless this recorder has failed before."""
        if self._lit and not SPARED.match(name) and name not in self._failed:
            self._failed.add(name)
            raise next(self._errors)


def fit(fuse: Fuse) -> None:
    """Make every call of a recorder pass the fuse."""
    call = Recorders.call

    def call_burning(
        self: Recorders,
        name: str,
        function: Callable[..., Any],
        /,
        *arguments: object,
        default: object = None,
        **named: object,
    ) -> Any:  # noqa: ANN401 - as the function
        def burning(*arguments: object, **named: object) -> Any:  # noqa: ANN401 - as the function
            fuse.burn(name)
            return function(*arguments, **named)

        return call(self, name, burning, *arguments, default=default, **named)

    Recorders.call = call_burning  # type: ignore[method-assign]


if __name__ == "__main__":
    fit(Fuse(sys.argv[1]))
    sys.exit(main(sys.argv[2:]))
