"""The robot's camera: one connection to the server of its MJPEG, for all pages that look.

It is open only while a page looks. Only the newest picture is kept. A server that fails is asked
again after a pause that grows to :data:`LONGEST_PAUSE_S`.

Each page asks for one picture after the other, and gets the newest: a slow page skips pictures, and
no queue grows. Its WebSocket is another one than that of its commands, which no picture delays.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import socket
import struct
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator

import h11
import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from yahboomd.core.clock import Clock
from yahboomd.web.mjpeg_parts import CameraRefusal, MjpegParts
from yahboomd.web.page_session import part
from yahboomd.web.session_files import Role, since_boot_ns

HEAD_S = 5.0
"""Time to connect and for the answer's header."""

PICTURE_S = 10.0
"""Time for the next whole picture."""

MAX_HEAD_BYTES = 16384
CHUNK_BYTES = 65536

UNREAD_BYTES = 262_144
"""The receive buffer requested from the kernel: pictures in it are older than they seem."""

MOST_PICTURES = 120
MOST_BYTES = 32_000_000
"""In a second. More is refused: reading slower would make pictures older than they seem."""

MOST_PIECES = 4000
"""The most chunks in a second besides the first of each read; chunks of one byte kept the server
busy for seconds."""

AT_ONCE = 50
"""After this number of them the pages have their turn."""

REPEATS_NS = 1_000_000_000
"""The time after which a repeated picture is reported."""

PAUSE_S = 1.0
LONGEST_PAUSE_S = 8.0

_ADDRESS = re.compile(
    r"http://(?P<authority>(?P<host>\[[^\]]*\]|[^:/]+)(:(?P<port>\d+))?)(?P<target>/.*)?"
)

Streams = tuple[asyncio.StreamReader, asyncio.StreamWriter]


class Picture(msgspec.Struct, frozen=True):
    """A picture of the camera.

    Attributes:
        number: Counts the new ones.
        came_ns: When its last byte arrived, by the clock including suspends.
    """

    number: int
    jpeg: bytes
    came_ns: int


class CameraFeed:
    """One camera.

    Args:
        address: As `web.camera` has it.
        connect: Opens a connection to a host and a port.

    Attributes:
        newest: The newest picture; None before the first since somebody looks.
        problem: The reason why no picture comes, for people; empty while they come.
        counts: ``pictures``, ``repeated`` (the same bytes again: not new), ``unusable`` (no JPEG
            that a browser shows), ``connected``, and every cause of a lost connection.
    """

    def __init__(
        self,
        address: str,
        clock: Clock,
        connect: Callable[[str, int], Awaitable[Streams]] | None = None,
    ) -> None:
        found = _ADDRESS.fullmatch(address)
        assert found is not None, "a checked address"
        self._host, self._port = found["host"].strip("[]"), int(found["port"] or 80)
        self._authority, self._target = found["authority"], found["target"] or "/"
        self._clock = clock
        self._connect = connect or _open
        self._changed = asyncio.Event()
        self._looking = 0
        self._following: asyncio.Task[None] | None = None
        self._not_before_s = 0.0
        self.newest: Picture | None = None
        self.problem = ""
        self.counts: Counter[str] = Counter()

    @contextlib.contextmanager
    def looked_at(self) -> Iterator[None]:
        """Somebody looks meanwhile: the connection is open."""
        self._looking += 1
        if self._following is None:
            self._following = asyncio.create_task(self._follow(), name="web-camera")
        try:
            yield
        finally:
            self._looking -= 1
            if not self._looking:
                self.close()

    def close(self) -> None:
        """End the connection, and forget the picture."""
        if self._following is not None:
            self._following.cancel()
            self._following = None
        self.newest = None

    async def news(self, number: int, problem: str, wait_s: float) -> Picture | None:
        """The newest picture if it is not that number; wait for one, or for another problem.

        Returns:
            None if none came in that time, or the problem changed.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(wait_s):
                while not self._is_newer(number) and self.problem == problem:
                    await self._changed.wait()
        return self.newest if self._is_newer(number) else None

    def age_ns(self, picture: Picture) -> int:
        """The time since it arrived."""
        return since_boot_ns(self._clock) - picture.came_ns

    def _is_newer(self, number: int) -> bool:
        return self.newest is not None and self.newest.number != number

    def _tell(self) -> None:
        """Wake everybody who waits for news."""
        self._changed.set()
        self._changed.clear()

    def _report(self, words: str) -> None:
        problem = f"The camera at {self._authority} {words}."
        if problem != self.problem:
            self.problem = problem
            self._tell()

    async def _follow(self) -> None:
        loop = asyncio.get_running_loop()
        pause_s = PAUSE_S
        while True:
            # Also if everybody looked away meanwhile: pages that come and go do not hurry it.
            await asyncio.sleep(max(0.0, self._not_before_s - loop.time()))
            before = self.counts["pictures"]
            why = await self._refusal()
            self.counts[why.cause] += 1
            came = self.counts["pictures"] > before
            pause_s = PAUSE_S if came else min(LONGEST_PAUSE_S, 2.0 * pause_s)
            self._not_before_s = loop.time() + pause_s
            self._report(f"{why.words}. It is asked again every few seconds")

    async def _refusal(self) -> CameraRefusal:
        """Pass pictures on until the connection ends; why it ended."""
        try:
            await self._receive()
        except CameraRefusal as refusal:
            return refusal
        except TimeoutError:
            return CameraRefusal("slow", "sends no whole picture in time")
        except h11.RemoteProtocolError:
            return CameraRefusal("not_http", "sends no proper answer of HTTP")
        except OSError as error:
            # asyncio's own text of it is for programmers.
            known = error.errno is not None and error.errno > 0
            words = os.strerror(error.errno or 0) if known else str(error).strip().rstrip(".")
            return CameraRefusal("no_answer", f"does not answer: {words}")
        except UnicodeError:
            return CameraRefusal("no_answer", "has a name that no machine can have")
        return _closed()

    async def _receive(self) -> None:
        loop = asyncio.get_running_loop()
        async with asyncio.timeout(HEAD_S) as patience:
            reader, writer = await self._connect(self._host, self._port)
            try:
                self.counts["connected"] += 1
                http = h11.Connection(h11.CLIENT, max_incomplete_event_size=MAX_HEAD_BYTES)
                writer.write(self._request(http))
                parts = MjpegParts(_boundary(await _event(http, reader)))
                patience.reschedule(loop.time() + PICTURE_S)
                rate = _Rate()
                while isinstance(event := await _event(http, reader, rate), h11.Data):
                    pictures = parts.feed(event.data)
                    unusable, parts.unusable = parts.unusable, 0
                    self.counts["unusable"] += unusable
                    for picture in pictures:
                        self._take(picture)
                        patience.reschedule(loop.time() + PICTURE_S)
                    rate.count(loop.time(), len(pictures) + unusable, len(event.data))
            finally:
                writer.transport.abort()

    def _request(self, http: h11.Connection) -> bytes:
        headers = [("Host", self._authority), ("Accept", "multipart/x-mixed-replace")]
        request = h11.Request(method="GET", target=self._target, headers=headers)
        return (http.send(request) or b"") + (http.send(h11.EndOfMessage()) or b"")

    def _take(self, jpeg: bytes) -> None:
        """Keep a picture if it is a new one, and tell everybody."""
        if self.newest is not None and jpeg == self.newest.jpeg:
            self.counts["repeated"] += 1
            if self.age_ns(self.newest) > REPEATS_NS:
                self._report("repeats one picture: nothing new comes")
            return
        self.counts["pictures"] += 1
        self.newest = Picture(self.counts["pictures"], jpeg, since_boot_ns(self._clock))
        self.problem = ""
        self._tell()


class _Rate:
    """Refuses a stream that would keep the server busy."""

    def __init__(self) -> None:
        self._since_s = 0.0
        self._pictures = self._bytes = self._pieces = 0

    async def piece(self) -> None:
        """Count a chunk that came with the one before."""
        self._pieces += 1
        if self._pieces % AT_ONCE == 0:
            await asyncio.sleep(0)

    def count(self, now_s: float, pictures: int, size: int) -> None:
        if now_s - self._since_s >= 1.0:
            self._since_s, self._pictures, self._bytes, self._pieces = now_s, 0, 0, 0
        self._pictures += pictures
        self._bytes += size
        if self._pieces > MOST_PIECES:
            raise CameraRefusal(
                "flood", f"sends more than {MOST_PIECES} chunks in a second: make them larger"
            )
        if self._pictures > MOST_PICTURES or self._bytes > MOST_BYTES:
            raise CameraRefusal(
                "flood",
                f"sends more than {MOST_PICTURES} pictures or {MOST_BYTES // 1_000_000} MB in a "
                "second: lower its rate or its size",
            )


async def _open(host: str, port: int) -> Streams:
    reader, writer = await asyncio.open_connection(host, port, limit=CHUNK_BYTES)
    own = writer.get_extra_info("socket")
    own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, UNREAD_BYTES)
    return reader, writer


async def _event(
    http: h11.Connection, reader: asyncio.StreamReader, rate: _Rate | None = None
) -> object:
    if (event := http.next_event()) is not h11.NEED_DATA and rate is not None:
        await rate.piece()
    while event is h11.NEED_DATA:
        if not (data := await reader.read(CHUNK_BYTES)):
            raise _closed()
        http.receive_data(data)
        event = http.next_event()
    return event


def _closed() -> CameraRefusal:
    return CameraRefusal("closed", "closed the connection")


def _boundary(answer: object) -> str:
    """The boundary of the parts of an answer.

    Raises:
        CameraRefusal: It is not MJPEG.
    """
    assert isinstance(answer, h11.Response | h11.InformationalResponse)
    status = answer.status_code
    if 300 <= status < 400:
        raise CameraRefusal(
            "redirect", "redirects to another address, which is not followed: name that one"
        )
    if status in {401, 403}:
        raise CameraRefusal("refused", f"wants a password (status {status}): serve it without one")
    if status != 200:
        raise CameraRefusal("refused", f"answers with status {status}: is the path right?")
    kind = dict(answer.headers).get(b"content-type", b"").decode("latin-1")
    name = re.match(r"[\w/.+-]{1,40}", kind, re.ASCII)
    if name is None or name[0].lower() != "multipart/x-mixed-replace":
        shown = "without a type" if name is None else name[0]
        raise CameraRefusal("wrong_type", f"sends {shown}, not MJPEG: name its stream")
    found = re.search(r';\s*boundary="?([^\s";]{1,100})', kind, re.IGNORECASE | re.ASCII)
    if found is None:
        raise CameraRefusal("no_boundary", "names no boundary between its pictures")
    return found[1]


MAX_LOOKING = 16
MAX_LOOKING_VIEWERS = 12
"""The most pages of viewers among them, so that drivers always find room."""

ANSWER_S = 1.0
"""A page that asks gets an answer after this time at the latest: it sees that the server lives."""

IDLE_S = 10.0
"""A page that asks for nothing in this time looks no longer."""

COUNTS = "counts"
"""The question for the counts; every other one is for a picture."""

COUNTS_S = 0.05
"""The pause after counts: three pages that asked for them without end delayed commands by 0.3 s."""

HEAD = struct.Struct(">II")
"""Before each picture: the milliseconds since it arrived here, and those that the page waited."""

POLICY, FULL = 1008, 1013
NS_PER_MS = 1_000_000


class CameraViewers:
    """Serves the camera to pages."""

    def __init__(self, feed: CameraFeed, clock: Clock) -> None:
        self._feed = feed
        self._clock = clock
        self._looking: list[Role] = []

    async def attend(self, socket: WebSocket, role: Callable[[], Role | None]) -> None:
        """Serve one page until it leaves, or falls silent.

        Args:
            role: Who looks; asked again before every picture, None ends it.
        """
        who = role()
        viewers = self._looking.count("viewer")
        if who is None:
            return
        if len(self._looking) >= MAX_LOOKING or (
            who == "viewer" and viewers >= MAX_LOOKING_VIEWERS
        ):
            text = f"{len(self._looking)} pages look already. Close one."
            await socket.close(FULL, text)
            return
        self._looking.append(who)
        try:
            with self._feed.looked_at(), contextlib.suppress(WebSocketDisconnect):
                await self._serve(socket, role)
        finally:
            self._looking.remove(who)

    async def _serve(self, socket: WebSocket, role: Callable[[], Role | None]) -> None:
        number, problem = 0, ""
        while (question := await _question(socket)) is not None:
            asked_ns = self._clock.now_ns()
            picture = None
            if question != COUNTS:
                picture = await self._feed.news(number, problem, ANSWER_S)
            if role() is None:
                await socket.close(POLICY, "This session has ended.")
                return
            if picture is None:
                problem = self._feed.problem
                await socket.send_text(
                    part("camera", problem=problem, counts=self._feed.counts).decode()
                )
                if question == COUNTS:
                    await asyncio.sleep(COUNTS_S)
                continue
            number, problem = picture.number, ""
            age_ns = self._feed.age_ns(picture)
            waited_ns = self._clock.now_ns() - asked_ns
            head = HEAD.pack(age_ns // NS_PER_MS + 1, waited_ns // NS_PER_MS)
            await socket.send_bytes(head + picture.jpeg)


async def _question(socket: WebSocket) -> str | None:
    """Wait for a page's next question; None if it left or fell silent."""
    try:
        async with asyncio.timeout(IDLE_S):
            return await socket.receive_text()
    except TimeoutError:
        await socket.close()
    except KeyError:
        await socket.close(POLICY, "This page sent what no page sends.")
    except WebSocketDisconnect:
        pass
    return None
