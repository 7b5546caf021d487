"""The first process of the container, in a process namespace of its own, with a stand-in daemon."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / "packaging/container.sh"
NAMESPACE = ("unshare", "--user", "--map-root-user", "--pid", "--fork", "--mount-proc")

pytestmark = pytest.mark.skipif(
    subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode != 0,
    reason="this machine gives no namespaces of processes",
)

CRASHES = """
setsid yahboomd-guard &
until grep -qs yahboomd-guard /proc/[0-9]*/comm; do sleep 0.01; done
kill -9 $$
"""
GUARD = "sleep 0.5; echo stopped > wheels"
ENDS = "trap 'exit 75' TERM; kill -TERM 1; while :; do sleep 0.05; done"


@pytest.fixture
def environ(tmp_path: Path) -> dict[str, str]:
    for name, text in (("yahboomd", CRASHES), ("yahboomd-guard", GUARD)):
        (tmp_path / name).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / name).chmod(0o755)
    return {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}


@pytest.mark.parametrize(("first", "stopped"), [(SCRIPT, True), ("yahboomd", False)])
def test_the_first_process_of_a_container_outlives_the_daemon_until_its_guard_is_done(
    environ: dict[str, str], tmp_path: Path, first: str, stopped: bool
) -> None:
    done = subprocess.run(
        [*NAMESPACE, first, "run"], env=environ, cwd=tmp_path, timeout=60, check=False
    )
    assert (tmp_path / "wheels").exists() is stopped
    assert not stopped or done.returncode == 128 + signal.SIGKILL


def test_the_first_process_of_a_container_hands_signals_and_status_on(
    environ: dict[str, str], tmp_path: Path
) -> None:
    (tmp_path / "yahboomd").write_text(f"#!/bin/sh\n{ENDS}\n")
    done = subprocess.run(
        [*NAMESPACE, SCRIPT, "run"], env=environ, cwd=tmp_path, timeout=60, check=False
    )
    assert done.returncode == 75
