"""HTTP of the sessions: a link becomes a cookie, and people see, name and end the sessions."""

from __future__ import annotations

import asyncio
import ipaddress
from typing import Any, TypeVar

import msgspec
from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import Response
from starlette.routing import Route

from yahboomd.core.clock import Clock, seconds
from yahboomd.core.model import NS_PER_S
from yahboomd.web.page_hub import PageHub
from yahboomd.web.page_session import MAX_BYTES
from yahboomd.web.phone_sessions import COUNTED, DAYS, PhoneSession, Refusal, device
from yahboomd.web.session_files import MINUTES, Role

T = TypeVar("T")

BODY_S = 5.0
"""Time for the body of a request to arrive."""

HOW = "For a new link: `yahboomd web --show-link` on the robot."

NO_SESSION = "This phone has no session: it gets in by a link, or by scanning its code."
OVER = (
    f"The session of this phone has ended: a person ended it, or it was not used for {DAYS} days."
)

WHY: dict[Refusal, str] = {
    "used": f"This link was used already: it lets one phone in, once. {HOW}",
    "old": f"This link is older than {MINUTES} minutes. {HOW}",
    "unknown": f"The robot does not know this link: it was used, or is too old. {HOW}",
    "disk": "The robot cannot store a session: its disk may be full. The link is still valid: make "
    "room, then open it again.",
}
"""Why a link lets nobody in."""


class Login(msgspec.Struct, frozen=True):
    """The body of ``POST /session``."""

    token: str


class NewName(msgspec.Struct, frozen=True):
    """The body of ``POST /session/name``."""

    name: str


class SessionRoutes:
    """The routes.

    Args:
        secure: Whether cookies may only travel over TLS.
        port: The port of the server; the cookies of each port have names of their own.
    """

    def __init__(self, hub: PageHub, clock: Clock, *, secure: bool, port: int) -> None:
        self._hub = hub
        self._sessions = hub.sessions
        self._secure = secure
        self._cookie = f"yahboomd-{port}"
        self._logins = RateLimit(clock, burst=10, every_s=6.0)
        self.routes = [
            Route("/session", self._session, methods=["GET"]),
            Route("/session", self._enter, methods=["POST"]),
            Route("/session/name", self._name, methods=["POST"]),
            Route("/sessions", self._list, methods=["GET"]),
            Route("/sessions/{number}/end", self._end, methods=["POST"]),
        ]

    def phone(self, connection: HTTPConnection) -> PhoneSession | None:
        """The session of the phone that asks."""
        cookie = connection.cookies.get(self._cookie, "")
        if self._sessions is None or not cookie:
            return None
        return self._sessions.of_cookie(cookie)

    def role(self, connection: HTTPConnection) -> Role | None:
        """The role of the person who asks; None without a session."""
        if self._sessions is None:
            return "driver"
        phone = self.phone(connection)
        return None if phone is None else phone.role

    def refusal(self, connection: HTTPConnection, **fields: object) -> Response:
        """The answer to a request without a session."""
        had = bool(connection.cookies.get(self._cookie))
        if had and self._sessions is not None:
            self._sessions.refused["ended"] += 1
        return json_answer(401, text=OVER if had else NO_SESSION, **fields)

    async def _session(self, request: Request) -> Response:
        role, phone = self.role(request), self.phone(request)
        if role is None:
            return self.refusal(request)
        name = "" if phone is None else phone.name
        answer = json_answer(200, role=role, robot=self._hub.robot.name, name=name)
        if phone is not None:
            # Each start of the page counts as use, for the browser too.
            self._give(answer, request.cookies[self._cookie])
        return answer

    async def _enter(self, request: Request) -> Response:
        address = request.client.host if request.client else ""
        if wait_s := self._logins.wait_s(address):
            if self._sessions is not None:
                self._sessions.refused["tries"] += 1
            words = f"Too many wrong links. Wait {wait_s} s, then try again."
            answer = json_answer(429, text=words)
            answer.headers["retry-after"] = str(wait_s)
            return answer
        token = await _read(request, Login)
        if isinstance(token, Response):
            return token
        answer = Response(status_code=204, headers={"cache-control": "no-store"})
        if self._sessions is None:
            return answer
        kind = device(request.headers.get("user-agent", ""))
        found = await self._sessions.enter(token.token, kind, self.phone(request))
        if isinstance(found, str):
            if found != "disk":
                self._logins.failed(address)
            return json_answer(503 if found == "disk" else 403, text=WHY[found])
        self._give(answer, found[1])
        return answer

    async def _name(self, request: Request) -> Response:
        phone = self.phone(request)
        if phone is None or self._sessions is None:
            return self.refusal(request)
        wanted = await _read(request, NewName)
        if isinstance(wanted, Response):
            return wanted
        words = await self._sessions.rename(phone, wanted.name)
        return json_answer(409 if words else 200, text=words, name=phone.name)

    async def _list(self, request: Request) -> Response:
        role, mine = self.role(request), self.phone(request)
        if role is None:
            return self.refusal(request)
        if self._sessions is None:
            return json_answer(200, sessions=[], refused=[], days=DAYS)
        driver = role == "driver"
        shown = [each for each in self._sessions.all if driver or each is mine]
        refused = self._sessions.refused if driver else {}
        return json_answer(
            200,
            sessions=[self._shown(each, mine) for each in shown],
            refused=[(COUNTED[reason], count) for reason, count in refused.items()],
            days=DAYS,
        )

    def _shown(self, session: PhoneSession, mine: PhoneSession | None) -> dict[str, Any]:
        assert self._sessions is not None
        return {
            "id": session.id,
            "name": session.name,
            "role": session.role,
            "mine": session is mine,
            "open": session.pages > 0,
            "control": self._hub.has_control(session),
            "idle_s": round(seconds(max(0, self._sessions.now_ns() - session.used_ns))),
        }

    async def _end(self, request: Request) -> Response:
        mine = self.phone(request)
        if mine is None or self._sessions is None:
            return self.refusal(request)
        number = request.path_params["number"]
        if mine.role != "driver" and mine.id != number:
            self._sessions.refused["viewer"] += 1
            return json_answer(403, text="This phone may only end its own session.")
        found = next((each for each in self._sessions.all if each.id == number), None)
        if found is None:
            return json_answer(404, text="This session has ended already.")
        by = "" if found is mine else f" by {mine.name}"
        words = await self._sessions.end(found, f"The session of this phone was ended{by}.")
        return json_answer(200, text=words)

    def _give(self, answer: Response, cookie: str) -> None:
        answer.set_cookie(
            self._cookie,
            cookie,
            max_age=DAYS * 24 * 3600,
            secure=self._secure,
            httponly=True,
            samesite="strict",
        )


def json_answer(status: int, **fields: object) -> Response:
    """An answer in JSON that nobody stores."""
    return Response(
        msgspec.json.encode(fields),
        status,
        media_type="application/json",
        headers={"cache-control": "no-store"},
    )


async def _read(request: Request, kind: type[T]) -> T | Response:
    """The body, decoded; else the answer to one that is too large, too slow or no such thing."""
    body = b""
    try:
        async with asyncio.timeout(BODY_S):
            async for chunk in request.stream():
                body += chunk
                if len(body) > MAX_BYTES:
                    return json_answer(413, text=f"At most {MAX_BYTES} bytes.")
    except (TimeoutError, ClientDisconnect):
        return json_answer(413, text=f"A request has to arrive within {BODY_S:.0f} s.")
    try:
        return msgspec.json.decode(body, type=kind)
    except (ValueError, RecursionError):
        return json_answer(400, text=f"This is no {kind.__name__.lower()}.")


ADDRESSES = 1024
"""The number of addresses remembered; the one with the oldest latest failure is dropped."""


class RateLimit:
    """Limits the failures of an address: a burst at once, then one every few seconds.

    Args:
        burst: Failures that are allowed at once.
        every_s: The seconds after which another one is allowed.
    """

    def __init__(self, clock: Clock, *, burst: int, every_s: float) -> None:
        self._clock = clock
        self._every_ns = round(every_s * NS_PER_S)
        self._most_ns = burst * self._every_ns
        # The time at which all failures of an address are forgiven.
        self._until_ns: dict[str, int] = {}

    def wait_s(self, address: str) -> int:
        """Whole seconds until this address may try again; 0 if it may now."""
        left_ns = self._until_ns.get(_network(address), 0) - self._clock.now_ns()
        over_ns = left_ns - self._most_ns + self._every_ns
        return -(-over_ns // NS_PER_S) if over_ns > 0 else 0

    def failed(self, address: str) -> None:
        """Count a failure."""
        network, now_ns = _network(address), self._clock.now_ns()
        until_ns = max(now_ns, self._until_ns.pop(network, 0)) + self._every_ns
        if len(self._until_ns) >= ADDRESSES:
            del self._until_ns[next(iter(self._until_ns))]
        self._until_ns[network] = until_ns


def _network(address: str) -> str:
    """The address; for IPv6 its /64, since one machine may use all of that."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        return address
    if found.version == 4:
        return address
    return str(ipaddress.ip_network((found, 64), strict=False))
