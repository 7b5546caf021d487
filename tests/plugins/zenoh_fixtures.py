"""Real Zenoh sessions and routers for tests. Whatever is started here is ended by its handle.

Import the fixtures by name in a conftest.py to have them.
"""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import zenoh
import zenoh.ext
from zenoh.handlers import Callback

from benchmarks.rig import free_endpoint

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PATIENCE_S = 60.0
"""No test is judged by time; after this time a condition has failed."""


async def eventually(condition: Callable[[], Any]) -> Any:
    """Wait until ``condition`` returns something true, and return that; else fail the test."""
    for _ in range(int(PATIENCE_S / 0.01)):
        if result := condition():
            return result
        await asyncio.sleep(0.01)
    pytest.fail(f"never came true: {condition}")


class ZenohRouter:
    """A router in a process of its own."""

    def __init__(self, endpoint: str) -> None:
        self.endpoint = endpoint
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start it; returns when it listens."""
        script = Path(__file__).with_name("zenoh_router_process.py")
        self._process = subprocess.Popen(
            [sys.executable, str(script), self.endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == b"ready\n"

    def kill(self) -> None:
        """End it as a power failure would."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()


@contextmanager
def late_subscriber(
    session: zenoh.Session, key: str, newest: int | None = None
) -> Iterator[list[zenoh.Sample]]:
    """The samples for a late subscriber, as a bridge and a node subscribe to a latched topic."""
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=newest)
    heard: list[zenoh.Sample] = []
    subscriber = zenoh.ext.declare_advanced_subscriber(session, key, heard.append, history=history)
    try:
        yield heard
    finally:
        subscriber.undeclare()


class ZenohApp:
    """An application: a session that is nothing of yahboomd's."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session

    def collect(self, key: str) -> list[zenoh.Sample]:
        """A list that grows by what arrives on ``key``."""
        samples: list[zenoh.Sample] = []
        self.session.declare_subscriber(key, Callback(samples.append, indirect=False))
        return samples

    async def ask(self, selector: str, **arguments: Any) -> list[zenoh.Reply]:
        """All replies to a query, off the loop."""
        return await asyncio.to_thread(
            lambda: list(self.session.get(selector, timeout=PATIENCE_S, **arguments))
        )

    async def reach(self, key: str) -> None:
        """Wait until somebody who subscribes to ``key`` is known to this session."""
        publisher = self.session.declare_publisher(key)
        try:
            await eventually(lambda: publisher.matching_status.matching)
        finally:
            publisher.undeclare()


@pytest.fixture
def zenoh_router() -> Iterator[ZenohRouter]:
    """A router, not yet started."""
    router = ZenohRouter(free_endpoint())
    yield router
    router.kill()


@pytest.fixture
def zenoh_app() -> Iterator[Callable[..., ZenohApp]]:
    """Opens applications: ``zenoh_app(mode, endpoint, {setting: value})``."""
    sessions: list[zenoh.Session] = []

    def start(mode: str, connect: str, settings: dict[str, Any] | None = None) -> ZenohApp:
        config = zenoh.Config()
        config.insert_json5("mode", json.dumps(mode))
        config.insert_json5("connect/endpoints", json.dumps([connect]))
        config.insert_json5("listen/endpoints", json.dumps([]))
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("transport/shared_memory/enabled", "false")
        for key, value in (settings or {}).items():
            config.insert_json5(key, json.dumps(value))
        sessions.append(zenoh.open(config))
        return ZenohApp(sessions[-1])

    yield start
    for session in sessions:
        session.close()
