"""Fixtures for the tests of every room."""

from __future__ import annotations

import asyncio
import functools
import importlib
import os
import re
import shutil
import signal
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from real_robot import client, real_robot
from zenoh_fixtures import zenoh_router

from yahboomd.blackbox.ring_file import ring_folder
from yahboomd.simulation import virtual_time

# A shell ignores these for what it starts in the background, `nohup` the first one, and every
# process inherits it.
for _number, _usual in (
    (signal.SIGHUP, signal.SIG_DFL),
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGQUIT, signal.SIG_DFL),
):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _usual)


# How long an example takes says how busy the machine is, not whether the code is right.
settings.register_profile(
    "explore", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=False
)
# The same examples every time: a change that fails is at fault itself. New ones are tried by
# `pytest --hypothesis-profile=explore`.
settings.register_profile("same examples", settings.get_profile("explore"), derandomize=True)
settings.load_profile("same examples")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """One process runs all tests of a file that is marked with ``xdist_group``.

    pytest-xdist 3.8 writes the group into an attribute that pytest 9 does not have any more.
    """
    if config.getoption("dist") != "loadgroup":
        return None
    scheduling = importlib.import_module("xdist.scheduler").LoadScopeScheduling

    @functools.cache
    def group_of(path: str) -> str | None:
        found = re.search(r'xdist_group\("(\w+)"\)', (config.rootpath / path).read_text())
        return found and found[1]

    class ByGroup(scheduling):  # type: ignore[misc, valid-type]
        def _split_scope(self, nodeid: str) -> str:
            return group_of(nodeid.partition("::")[0]) or nodeid

    return ByGroup(config, log)


__all__ = ["client", "real_robot", "virtual_time_run", "zenoh_router"]


@pytest.fixture(scope="session", autouse=True)
def runtime_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Daemons and stops of these tests find only each other, whatever else this machine runs."""
    runtime = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RUNTIME_DIRECTORY", str(runtime))
        patch.setenv("STATE_DIRECTORY", str(tmp_path_factory.mktemp("state")))
        yield
    # The rings of daemons that were killed.
    if (rings := ring_folder(runtime, os.getuid())) != runtime:
        shutil.rmtree(rings, ignore_errors=True)


@pytest.fixture
async def tasks_end() -> AsyncIterator[None]:
    """Set up before all else and torn down after it: whatever still runs then was left behind."""
    yield
    # Those that were cancelled last get the turns that they need to end.
    for _ in range(10):
        await asyncio.sleep(0)
    left = asyncio.all_tasks() - {asyncio.current_task()}
    assert not left, f"tasks were left behind: {', '.join(task.get_name() for task in left)}"


@pytest.fixture(autouse=True)
def no_task_is_left_behind(request: pytest.FixtureRequest) -> None:
    """A leaked task fails its test, on a real loop as on virtual time."""
    if request.node.get_closest_marker("asyncio") is not None:
        request.getfixturevalue("tasks_end")


@pytest.fixture
def virtual_time_run() -> Callable[[Coroutine[Any, Any, Any]], Any]:
    """Runs a coroutine on an event loop whose time jumps to the next timer: no waiting.

    A whole test can run so with the decorator ``yahboomd.simulation.virtual_time.on_virtual_time``.
    """
    return virtual_time.run
