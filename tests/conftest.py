"""Fixtures for the tests of every room."""

from __future__ import annotations

import asyncio
import ctypes
import gc
import os
import shutil
import signal
import zlib
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import suppress
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from real_robot import client, real_robot
from zenoh_fixtures import zenoh_router

from yahboomd.blackbox.ring_file import ring_folder
from yahboomd.simulation import virtual_time

# A shell ignores these for its background jobs, `nohup` the first one, and every process inherits
# it.
for _number, _usual in (
    (signal.SIGHUP, signal.SIG_DFL),
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGQUIT, signal.SIG_DFL),
):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, _usual)

# The duration of an example depends on how busy the machine is, not on the code.
settings.register_profile(
    "explore", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=False
)
# The same examples every time: a change that fails is at fault itself. New ones are tried by
# `pytest --hypothesis-profile=explore`.
settings.register_profile("many", settings.get_profile("explore"), derandomize=True)
settings.register_profile("same examples", settings.get_profile("many"), max_examples=50)
# The short loop of `make quick`.
settings.register_profile("few", settings.get_profile("many"), max_examples=20)
settings.load_profile("same examples")

ROOT = Path(__file__).parents[1]
BUILDING = {"browser", "clients", "firmware", "generators", "interop", "system"}
"""Suites whose compilers and containers keep files in the home folder and in /run."""

# <sched.h>, <sys/mount.h>
_CLONE_NEWNS, _MS_REC, _MS_PRIVATE = 0x20000, 0x4000, 0x40000


def pytest_configure(config: pytest.Config) -> None:
    """Give each worker a session of its own: the kernel shares a busy machine out by sessions.

    Without it, every process of a test gets as little as each process that the machine is busy
    with, and a daemon does not run for seconds at a time.
    """
    if hasattr(config, "workerinput") and os.getsid(0) != os.getpid():
        os.setsid()
        # Of a session the kernel takes this value for its priority, not those of its processes.
        with suppress(OSError):
            Path("/proc/self/autogroup").write_text(str(os.getpriority(os.PRIO_PROCESS, 0)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Thousands of tests are made, and none of them is garbage."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makeitem(collector: pytest.Collector, obj: object) -> list[Any] | None:
    """Make no item of a nightly test where none runs: each worker would, for all their cases."""
    marks = obj.__dict__.get("pytestmark", ()) if isinstance(obj, FunctionType) else ()
    nightly = any(mark.name == "nightly" for mark in marks)
    return [] if nightly and collector.config.option.markexpr == "not nightly" else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the cases of a test beyond ``@pytest.mark.cases(NUMBER)``: they are nightly.

    A checksum of their names picks them, so that each run takes the same ones.
    """
    tests: dict[tuple[str, int], list[pytest.Item]] = defaultdict(list)
    for item in items:
        if marker := item.get_closest_marker("cases"):
            tests[item.nodeid.partition("[")[0], marker.args[0]].append(item)
    for (_, number), cases in tests.items():
        cases.sort(key=lambda case: zlib.crc32(case.nodeid.encode()))
        for case in cases[number:]:
            case.add_marker("nightly")


__all__ = [
    "client",
    "real_robot",
    "virtual_time_run",
    "zenoh_router",
]


def _remove_rings(runtime: Path) -> None:
    """A ring outlives the folder that it belongs to, of an earlier run with the same name too."""
    rings = ring_folder(runtime, os.getuid())
    if rings is not None and rings != runtime:
        shutil.rmtree(rings, ignore_errors=True)


@pytest.fixture(scope="session", autouse=True)
def patience() -> Iterator[None]:
    """Disk and threads of this process are waited for, however busy the machine is.

    Each of these is a promise for a disk that hangs; a test of it sets its own.
    """
    with pytest.MonkeyPatch.context() as patch:
        for name in (
            "yahboomd.blackbox.box_writer.END_S",
            "yahboomd.core.daemon.estop.latch.LOAD_WITHIN_S",
            "yahboomd.core.daemon.estop.latch.RELEASE_WITHIN_S",
            "yahboomd.core.daemon.estop.latch.SETTLE_S",
            "yahboomd.core.link.port_guard.LISTENS_WITHIN_S",
            "yahboomd.core.daemon.logs.FLUSH_S",
            "yahboomd.simulation.virtual_time.REAL_PATIENCE_S",
        ):
            patch.setattr(name, 60.0)
        yield


def _hide_run() -> None:
    """Give root's tests an empty /run: every ``stop`` looks at /run/yahboomd and its like."""
    libc = ctypes.CDLL(None, use_errno=True)
    if os.geteuid() == 0 and libc.unshare(_CLONE_NEWNS) == 0:
        private = libc.mount(b"none", b"/", None, _MS_REC | _MS_PRIVATE, None)
        if private or libc.mount(b"tmpfs", b"/run", b"tmpfs", 0, b"mode=755"):
            raise OSError(ctypes.get_errno(), "the tests' own /run")


@pytest.fixture(scope="session", autouse=True)
def runtime_folder(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[None]:
    """Daemons, stops and people's files of these tests are apart from the machine's own."""
    runtime = tmp_path_factory.mktemp("run")
    _remove_rings(runtime)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RUNTIME_DIRECTORY", str(runtime))
        patch.setenv("STATE_DIRECTORY", str(tmp_path_factory.mktemp("state")))
        folders = {item.path.relative_to(ROOT).parent for item in request.session.items}
        if BUILDING.isdisjoint(part for folder in folders for part in folder.parts):
            _hide_run()
            for name in ("HOME", "XDG_RUNTIME_DIR"):
                patch.setenv(name, str(tmp_path_factory.mktemp(name.lower())))
            for name in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_DATA_HOME"):
                patch.delenv(name, raising=False)
        yield
    # The rings of daemons that were killed, and the folders of all.
    for folder, _, _ in os.walk(tmp_path_factory.getbasetemp()):
        _remove_rings(Path(folder))


@pytest.fixture(autouse=True)
def no_ring_is_there(request: pytest.FixtureRequest) -> Iterator[None]:
    """A test begins without rings in its own folders, and leaves none."""
    if "tmp_path" not in request.fixturenames:
        yield
        return
    own: Path = request.getfixturevalue("tmp_path")
    _remove_rings(own / "run")
    yield
    _remove_rings(own / "run")


@pytest.fixture
async def tasks_end() -> AsyncIterator[None]:
    """Set up before all else and torn down after it: whatever still runs then was left behind."""
    yield
    # Those that were cancelled last get the turns that they need to end.
    for _ in range(100):
        await asyncio.sleep(0)
        if not (left := asyncio.all_tasks() - {asyncio.current_task()}):
            break
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
