"""Guards that a test left: without their simulated boards they would never see the wheels stand."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path

from yahboomd.tools.stop.unresponsive import is_guard


def end_guards() -> None:
    """End those of the running test."""
    test = os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")[0]
    for pid in (int(name) for name in os.listdir("/proc") if name.isdigit()):
        with contextlib.suppress(OSError):
            environ = Path(f"/proc/{pid}/environ")
            if is_guard(pid) and test in environ.read_text(errors="replace"):
                os.kill(pid, signal.SIGKILL)
