"""HTTP: the page's files, the sessions, the emergency stop, the WebSocket.

Every request passes :class:`OriginGuard` first: Host, Origin, and the headers of every answer.
The page's files are read and compressed once, and looked up by name only.
"""

from __future__ import annotations

import asyncio
import gzip
import hashlib
import ipaddress
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import msgspec
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from yahboomd.core.clock import Clock
from yahboomd.core.messages.status_fields import FIELDS, StatusField
from yahboomd.web.camera import CameraViewers
from yahboomd.web.page_downloads import Downloads
from yahboomd.web.page_hub import PageHub
from yahboomd.web.session_routes import SessionRoutes, json_answer

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

HEADERS: Final = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' data:; connect-src 'self'; manifest-src 'self'; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'none'",
    "x-frame-options": "DENY",
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=(), payment=(), usb=()",
}
"""The headers of every answer."""


class WebApplication:
    """The application of one robot.

    Args:
        origin: Recognises requests of our own page.
        secure: Whether cookies may only travel over TLS.
        port: The port that it is served on; the cookies of each port have names of their own.
    """

    def __init__(
        self,
        hub: PageHub,
        files: Mapping[str, PageFile],
        origin: RequestOrigin,
        clock: Clock,
        *,
        secure: bool,
        port: int,
    ) -> None:
        self._hub = hub
        self._files = files
        self._access = access = SessionRoutes(hub, clock, secure=secure, port=port)
        routes = [
            Route("/", self._file, methods=["GET"]),
            Route("/page/{name:path}", self._file, methods=["GET"]),
            Route("/counters", self._counters, methods=["GET"]),
            *access.routes,
            Route("/estop", self._estop, methods=["POST"]),
            *Downloads(hub.tools, access.role).routes,
            WebSocketRoute("/ws", self._page),
        ]
        if hub.fleet is not None:
            routes.append(Route("/fleet", self._fleet, methods=["GET"]))
            routes.append(Route("/fleet/stop", self._stop_fleet, methods=["POST"]))
        if hub.camera is not None:
            self._viewers = CameraViewers(hub.camera, clock)
            routes.append(WebSocketRoute("/camera", self._camera))
        self.asgi: ASGIApp = OriginGuard(Starlette(routes=routes), origin)

    async def _file(self, request: Request) -> Response:
        file = self._files.get(request.path_params.get("name", "index.html"))
        if file is None:
            return PlainTextResponse("There is no such file.\n", 404)
        headers = {"etag": file.etag, "cache-control": "no-cache", "vary": "accept-encoding"}
        if request.headers.get("if-none-match") == file.etag:
            return Response(status_code=304, headers=headers)
        content = file.content
        if file.compressed and "gzip" in request.headers.get("accept-encoding", ""):
            content = file.compressed
            headers["content-encoding"] = "gzip"
        return Response(content, media_type=file.kind, headers=headers)

    async def _counters(self, _request: Request) -> Response:
        """The meaning of each field of the status, by group and name."""
        groups: dict[str, dict[str, StatusField]] = {}
        for field in FIELDS:
            groups.setdefault(field.group, {})[field.name] = field
        return Response(msgspec.json.encode(groups), media_type="application/json")

    async def _estop(self, request: Request) -> Response:
        if self._access.role(request) is None:
            return self._access.refusal(request, engaged=False)
        answer = await asyncio.shield(self._hub.robot.engage())
        if answer.success:
            return json_answer(200, engaged=True, text=answer.message)
        text = f"{answer.message} Switch the motors' supply off."
        return json_answer(503, engaged=False, text=text)

    async def _fleet(self, request: Request) -> Response:
        assert self._hub.fleet is not None
        if self._access.role(request) is None:
            return self._access.refusal(request)
        return json_answer(200, **self._hub.fleet.shown())

    async def _stop_fleet(self, request: Request) -> Response:
        """Stop all robots; everybody who may stop this one may."""
        assert self._hub.fleet is not None
        if self._access.role(request) is None:
            return self._access.refusal(request)
        self._hub.fleet.stop()
        return json_answer(200, **self._hub.fleet.shown())

    async def _page(self, socket: WebSocket) -> None:
        phone = self._access.phone(socket)
        if not self._hub.lets_in(phone):
            await socket.send_denial_response(self._access.refusal(socket))
            return
        await socket.accept()
        await self._hub.attend(socket, phone)

    async def _camera(self, socket: WebSocket) -> None:
        if self._access.role(socket) is None:
            await socket.send_denial_response(self._access.refusal(socket))
            return
        await socket.accept()
        await self._viewers.attend(socket, lambda: self._access.role(socket))


class OriginGuard:
    """Refuses requests that are not from our own page, and adds the headers of every answer."""

    def __init__(self, application: ASGIApp, origin: RequestOrigin) -> None:
        self._application = application
        self._origin = origin

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one request, as ASGI has it."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] in {"http.response.start", "websocket.http.response.start"}:
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        refusal = self._refusal(scope, Headers(scope=scope))
        await (refusal or self._application)(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope, headers: Headers) -> Response | None:
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        if len(hosts) != 1 or not self._origin.host_is_ours(hosts[0]):
            return PlainTextResponse(
                "Refused: the page is not served under this name, because any website could have "
                "it point here. Open it by address, or allow the name: "
                "yahboomd web --host-name NAME.\n",
                421,
            )
        harmless = scope["type"] == "http" and scope["method"] in {"GET", "HEAD"}
        if (origins or not harmless) and (
            len(origins) != 1 or not self._origin.origin_is_ours(origins[0], hosts[0])
        ):
            return PlainTextResponse("Refused: this is not from the robot's own page.\n", 403)
        return None


_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[^\[\]:@/?#\s]+)(?::\d{1,5})?\Z")


class RequestOrigin:
    """Checks by Host and Origin whether a request comes from our own page.

    Any website can point a name of its own at this machine (DNS rebinding), and any website's
    script can send requests here. So Host has to be an address or a name of this machine, and
    Origin, which a script cannot forge, has to match it.

    Args:
        names: The names of this machine, besides its addresses.
        local: Whether only programs on this machine reach it: then only `localhost` and loopback
            addresses are accepted.
        tls: Whether it is served over TLS.
    """

    def __init__(self, names: Collection[str], *, local: bool, tls: bool) -> None:
        self._names = {name.lower().rstrip(".") for name in names} | {"localhost"}
        self._local = local
        self._scheme = "https" if tls else "http"

    def host_is_ours(self, host: str) -> bool:
        """Whether the Host header names this machine."""
        found = _HOST.match(host)
        if found is None:
            return False
        name = found["name"].lower().rstrip(".")
        try:
            address = ipaddress.ip_address(name.strip("[]"))
        except ValueError:
            return name in self._names
        return address.is_loopback or not self._local

    def origin_is_ours(self, origin: str, host: str) -> bool:
        """Whether the Origin header names the page that Host names."""
        try:
            parts = urlsplit(origin)
        except ValueError:
            return False
        return (parts.scheme, parts.netloc.lower()) == (self._scheme, host.lower())


FOLDER = Path(__file__).with_name("page")

TYPES: Mapping[str, str] = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".webmanifest": "application/manifest+json",
}
"""The content types of served files, by suffix."""


class PageFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file of the page.

    Attributes:
        compressed: The content with gzip; empty if that is not smaller.
        etag: Changes with the content.
    """

    content: bytes
    compressed: bytes
    kind: str
    etag: str


def page_files(folder: Path = FOLDER) -> dict[str, PageFile]:
    """Every file of the page, by its path below the folder."""
    return {
        path.relative_to(folder).as_posix(): _file(path)
        for path in sorted(folder.rglob("*"))
        if path.suffix in TYPES and path.is_file()
    }


def _file(path: Path) -> PageFile:
    content = path.read_bytes()
    compressed = gzip.compress(content, mtime=0)
    return PageFile(
        content=content,
        compressed=compressed if len(compressed) < len(content) else b"",
        kind=TYPES[path.suffix],
        etag=f'"{hashlib.sha256(content).hexdigest()[:20]}"',
    )
