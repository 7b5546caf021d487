"""The page's server in the loop of a test, and pages on real sockets: ``await site.page()``.

Import the fixture by name in a conftest.py to have it.
"""

from __future__ import annotations

import asyncio
import json
import resource
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Self

import msgspec
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from zenoh_fixtures import PATIENCE_S, eventually

from yahboomd.client.connection import client_options
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import read
from yahboomd.web.page_hub import PageHub
from yahboomd.web.page_tools import RobotList, ToolSettings
from yahboomd.web.session_files import PREFIX, Role, StoredSession, digest, keep, make_entry
from yahboomd.web.web_application import FOLDER, RequestOrigin, WebApplication, page_files
from yahboomd.web.web_server import WebServer, listen

ZERO = (0.0, 0.0)


@contextmanager
def full_disk() -> Iterator[None]:
    """The kernel refuses each byte that this process writes to a file."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


class Page:
    """A page: a WebSocket that remembers its messages."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.came: list[dict[str, Any]] = []
        self.beat = -1
        self._reading = asyncio.create_task(self._read())

    async def _read(self) -> None:
        with suppress(ConnectionClosed):
            async for frame in self.socket:
                for each in json.loads(frame):
                    self.came.append(each)
                    if each["type"] == "beat":
                        self.beat = each["beat"]

    def of(self, kind: str) -> list[dict[str, Any]]:
        """The objects of a kind that came."""
        return [each for each in self.came if each["type"] == kind]

    async def one(self, kind: str, **fields: Any) -> dict[str, Any]:
        """Wait for an object with these fields."""

        def found() -> dict[str, Any] | None:
            for each in self.of(kind):
                if all(each[name] == value for name, value in fields.items()):
                    return each
            return None

        result: dict[str, Any] = await eventually(found)
        return result

    async def send(self, **fields: Any) -> None:
        """Send one frame."""
        await self.socket.send(json.dumps(fields))

    async def drive(
        self, vx: float = 0.2, wz: float = 0.0, *, vy: float = 0.0, beat: int | None = None
    ) -> None:
        """Send a command with the last beat."""
        await eventually(lambda: self.beat >= 0)
        await self.send(type="drive", beat=self.beat if beat is None else beat, vx=vx, vy=vy, wz=wz)

    async def hold(self, until: Callable[[], Any], vx: float = 0.2) -> Any:
        """Drive 20 times a second until something is true, whatever is refused."""
        while not (found := until()):
            await self.drive(vx)
            await asyncio.sleep(0.05)
        return found

    async def refused(self, why: str, frame: str = "drive", **fields: Any) -> dict[str, Any]:
        """Send a frame with the last beat until it is refused for this reason; the refusal.

        Again where another refusal came just before, or this machine was too busy.
        """
        await eventually(lambda: self.beat >= 0)
        while True:
            for each in self.of("refused"):
                if (each["what"], each["why"]) == (frame, why):
                    return each
            await self.send(type=frame, beat=self.beat, **fields)
            await asyncio.sleep(0.05)

    async def press(self, until: Callable[[], Any], vx: float = 0.2) -> Any:
        """Drive until something is true; if this machine was too busy, let go and press again."""
        refused = len(self.of("refused"))
        while not (found := until()):
            if len(self.of("refused")) > refused:
                refused = len(self.of("refused"))
                await self.drive(0.0)
            await self.drive(vx)
            await asyncio.sleep(0.05)
        return found

    async def close_code(self) -> int:
        """Wait until the server closes it; the code."""
        async with asyncio.timeout(PATIENCE_S):
            await self._reading
        code: int = self.socket.close_code or 0
        return code

    async def close(self) -> None:
        """Leave."""
        await self.socket.close()
        self._reading.cancel()
        await asyncio.gather(self._reading, return_exceptions=True)


class Site:
    """A server of the page, for one daemon."""

    def __init__(
        self,
        endpoint: str,
        state: Path,
        *,
        phones: bool = False,
        context: ssl.SSLContext | None = None,
        clock: SystemClock | None = None,
        namespace: str = "",
        folder: Path = FOLDER,
        camera: str = "",
        fleet: RobotList | None = None,
    ) -> None:
        clock = clock or SystemClock()
        self._listener = listen("127.0.0.1", 0)
        self.port: int = self._listener.getsockname()[1]
        self.state = state / "phones"
        self.clock = clock
        self.origin = f"{'https' if context else 'http'}://127.0.0.1:{self.port}"
        # The state directory of root is the machine's.
        files = (
            f"--set=chassis.calibration_file={state / 'calibration.toml'}",
            f"--set=blackbox.folder={state / 'boxes'}",
        )
        overrides = [each.removeprefix("--set=") for each in files]
        tools = ToolSettings(
            robot=(f"--connect={endpoint}", *files),
            recordings=state / "recordings",
            load=lambda: read(None, environ={}, overrides=overrides),
            camera=camera,
            fleet=fleet,
        )
        options = client_options(endpoint, namespace=namespace)
        self.hub = PageHub(options, clock, tools, phones=self.state if phones else None)
        self.sessions = self.hub.sessions
        if self.sessions is not None:
            self.sessions.start()
        application = WebApplication(
            self.hub,
            page_files(folder),
            RequestOrigin([], local=True, tls=context is not None),
            clock,
            secure=context is not None,
            port=self.port,
        )
        self.server = WebServer(application.asgi, context)
        self._tasks: list[asyncio.Task[None]] = []
        self._pages: list[Page] = []

    async def start(self) -> Self:
        """Serve."""
        self._tasks = [
            asyncio.create_task(self.hub.run()),
            asyncio.create_task(self.server.serve(sockets=[self._listener])),
        ]
        await eventually(lambda: self.server.started)
        return self

    def link(self, role: Role = "driver") -> str:
        """The token of a new link."""
        return make_entry(self.state, role, self.clock)

    def cookie(self, role: str = "driver", name: str = "") -> dict[str, str]:
        """The header of a phone that was let in; one of each role and name."""
        name = name or role.capitalize()
        number = digest(role + name)[:6]
        key = digest(number)
        is_driver = role == "driver"
        stored = StoredSession(
            role="driver" if is_driver else "viewer", name=name, key=digest(key), made_s=0
        )
        assert self.sessions is not None
        if number not in {each.id for each in self.sessions.all}:
            keep(self.state, f"{PREFIX}{number}", msgspec.json.encode(stored))
            self.sessions._merge(self.sessions._scan(0))
        return {"Cookie": f"yahboomd-{self.port}={number}.{key}"}

    async def page(self, role: str = "driver", name: str = "", **options: Any) -> Page:
        """Open a page, and wait until it knows its role."""
        headers = self.cookie(role, name) if self.sessions else {}
        page = await self.open(additional_headers=headers, **options)
        await page.one("hello")
        return page

    async def driver(self, **options: Any) -> Page:
        """Open a page, and give it control."""
        page = await self.page(**options)
        await page.send(type="control", want=True)
        await page.one("control", mine=True)
        return page

    async def open(self, **options: Any) -> Page:
        """Open a WebSocket."""
        address = self.origin.replace("http", "ws", 1) + "/ws"
        usual = {"origin": self.origin, "compression": None, "open_timeout": PATIENCE_S}
        options = {**usual, **options}
        page = Page(await connect(address, **options))
        self._pages.append(page)
        return page

    async def request(
        self, method: str, path: str, body: bytes = b"", **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Ask as a browser on our own page does; status, headers and body of the answer."""
        given = {
            "Host": f"127.0.0.1:{self.port}",
            **({} if method == "GET" else {"Origin": self.origin}),
            "Content-Length": str(len(body)),
            "Connection": "close",
            **{name.replace("_", "-"): value for name, value in headers.items()},
        }
        lines = [f"{method} {path} HTTP/1.1"]
        lines += [f"{name}: {value}" for name, value in given.items() if value]
        return await self.raw("\r\n".join([*lines, "", ""]).encode() + body)

    async def raw(self, request: bytes) -> tuple[int, dict[str, str], bytes]:
        """Send these bytes; status, headers and body of the answer."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.port)
        writer.write(request)
        answer = await reader.read()
        writer.close()
        head, _, content = answer.partition(b"\r\n\r\n")
        first, *rest = head.decode().split("\r\n")
        found = {
            name.strip().lower(): value.strip()
            for name, _, value in (line.partition(":") for line in rest)
        }
        return int(first.split()[1]), found, content

    async def close(self) -> None:
        """End it."""
        for page in self._pages:
            await page.close()
        self.hub.stop()
        self.server.should_exit = True
        robot, server = self._tasks
        await server
        robot.cancel()
        await asyncio.gather(robot, return_exceptions=True)


@pytest.fixture
async def site(fake_daemon: Any, tmp_path: Path) -> AsyncIterator[Callable[..., Awaitable[Site]]]:
    """Starts servers: ``await site(daemon)``, with or without a daemon behind them."""
    sites: list[Site] = []

    async def start(daemon: Any = None, endpoint: str = "", **options: Any) -> Site:
        where = daemon.endpoint if daemon is not None else endpoint
        sites.append(Site(where, tmp_path, **options))
        await sites[-1].start()
        if daemon is not None:
            await eventually(lambda: sites[-1].hub.robot.obstacle() is None)
        return sites[-1]

    yield start
    for each in sites:
        await each.close()
