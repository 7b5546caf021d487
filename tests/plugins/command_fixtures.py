"""Fixtures of the tests of commands and of their tools."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import pytest
from fake_daemon import fake_daemon
from real_robot import PATIENCE_S, Client, RealRobot
from simulated_board import simulated_board
from terminal_process import terminal

from yahboomd.cli.main import main
from yahboomd.client import services
from yahboomd.core import program
from yahboomd.tools.stop import stop_local

__all__ = [
    "_is_on_the_path",
    "fake_daemon",
    "on_robot",
    "one_robot",
    "patience",
    "pytest_runtest_teardown",
    "simulated_board",
    "terminal",
    "yahboomd",
]


@pytest.fixture(autouse=True)
def _is_on_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands in texts are named as where yahboomd is on the PATH, wherever the tests run."""
    monkeypatch.setattr(program, "name", lambda: "yahboomd")


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A daemon that a busy machine holds up is waited for: none may be silent on purpose."""
    monkeypatch.setattr(stop_local, "STATUS_WITHIN_S", PATIENCE_S)
    for name in ("ask", "ask_urgently"):
        monkeypatch.setattr(services, name, _patient(getattr(services, name)))


def _patient(ask: Callable[..., Any]) -> Callable[..., Any]:
    async def patient(*arguments: Any, **options: Any) -> Any:
        # A query ends early, and empty, if the machine was so busy that the connection lapsed.
        for _ in range(3):
            if answers := await ask(*arguments, **{**options, "timeout_s": PATIENCE_S}):
                break
        return answers

    return patient


_running: list[RealRobot] = []


@pytest.fixture
def one_robot(tmp_path_factory: pytest.TempPathFactory) -> RealRobot:
    """A real daemon on a simulated board for many tests, which leave it ready to drive.

    Tests that use it are marked ``xdist_group("one_robot")``: they share its state.
    """
    if not _running:
        made = RealRobot(tmp_path_factory.mktemp("robot"))
        _running.append(made)
        made.daemon.says("Connected to")
        application = Client("client", made.endpoint)
        application.in_state("standing")
        application.close()
    return _running[0]


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(nextitem: pytest.Item | None) -> None:
    """End that robot behind the last test of its group: until the session ends it costs time."""
    group = nextitem and nextitem.get_closest_marker("xdist_group")
    if _running and not (group and group.args == ("one_robot",)):
        _running.pop().close()


@pytest.fixture
def on_robot(
    one_robot: RealRobot, patience: None, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., int]:
    """Run a command on that robot in this process; its exit status."""
    for name in [each for each in os.environ if each.startswith("YAHBOOMD_")]:
        monkeypatch.delenv(name)

    def run(*arguments: str) -> int:
        return main([*arguments, "--connect", one_robot.endpoint])

    return run


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
            timeout=120,
            check=False,
        )

    return run
