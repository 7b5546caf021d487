from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable

import pytest
from fake_daemon import fake_daemon
from simulated_board import simulated_board
from terminal_process import terminal

__all__ = ["fake_daemon", "simulated_board", "terminal", "yahboomd"]


@pytest.fixture
def yahboomd(tmp_path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command in a process of its own, with no configuration of this machine's."""

    def run(*arguments: str, **environ: str) -> subprocess.CompletedProcess[str]:
        clean = {key: value for key, value in os.environ.items() if "YAHBOOMD_" not in key}
        return subprocess.run(
            [sys.executable, "-W", "error", "-m", "yahboomd", *arguments],
            env=clean | environ,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    return run
