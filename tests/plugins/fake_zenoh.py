"""Zenoh's sessions in memory, as far as the bus and its clients use them.

A callback runs in the thread of the call that causes it. `tests/bus/test_real_zenoh.py` compares
them with real ones. Import the fixture by name in a conftest.py to have it.
"""

from __future__ import annotations

import itertools
import json
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any, Self

import pytest
import zenoh

from yahboomd.client import streams
from yahboomd.core.bus import subscriptions

PUT, DELETE = zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE


class Ring:
    """The newest samples, for who asks."""

    def __init__(self, capacity: int | None = None) -> None:
        self._samples: deque[Any] = deque(maxlen=capacity)
        self.callback = self._samples.append

    def try_recv(self) -> Any:
        return self._samples.popleft() if self._samples else None


class Declared:
    """Something that a session declared on a key, until it is undeclared."""

    def __init__(self, session: FakeSession, place: list[Any], key: str, handler: Any) -> None:
        self.session, self._place = session, place
        self.key_expr = zenoh.KeyExpr(key)
        self.handler = Ring() if handler is None else handler
        self.call = getattr(self.handler, "callback", self.handler)
        self.seen = set[str]()
        self.complete = False
        place.append(self)

    def on(self, key: zenoh.KeyExpr) -> bool:
        return self.key_expr.intersects(key)

    def try_recv(self) -> Any:
        return self.handler.try_recv()

    def undeclare(self) -> None:
        if self in self._place:
            self._place.remove(self)
            self.session.zenoh.look()


class FakePublisher:
    """A publisher; knows whether its session reaches a subscriber."""

    def __init__(self, session: FakeSession, key: str, options: dict[str, Any]) -> None:
        self._session, self._options = session, options
        self.key_expr = zenoh.KeyExpr(key)
        self._listeners: list[Callable[[Any], None]] = []
        self._matched = self.matching_status.matching

    @property
    def matching_status(self) -> Any:
        reached = self._session.reach()
        subscribers = itertools.chain.from_iterable(each.subscribers for each in reached)
        return SimpleNamespace(matching=any(each.on(self.key_expr) for each in subscribers))

    def declare_matching_listener(self, handler: Any) -> None:
        self._listeners.append(handler.callback)

    def look(self) -> None:
        status = self.matching_status
        if status.matching != self._matched:
            self._matched = status.matching
            for listener in self._listeners:
                listener(status)

    def put(self, payload: bytes, **options: Any) -> None:
        self._session.put(str(self.key_expr), payload, **self._options, **options)

    def undeclare(self) -> None:
        self._session.publishers.remove(self)


class FakeQuery:
    """A question at one service; its asker waits until it is dropped."""

    def __init__(self, selector: zenoh.Selector, options: dict[str, Any], asked: Asked) -> None:
        self.key_expr, self.parameters = selector.key_expr, selector.parameters
        self.payload = _bytes(options.get("payload"))
        self.attachment = _bytes(options.get("attachment"))
        self.encoding = options.get("encoding")
        self._asked = asked

    def reply(self, key: str, payload: bytes, **options: Any) -> None:
        self._asked.reply(SimpleNamespace(ok=_sample(key, payload, PUT, options), err=None))

    def drop(self) -> None:
        asked, self._asked = self._asked, None
        if asked is not None:
            asked.drop()

    __del__ = drop


class Asked:
    """The replies to a query, for a callback or for who iterates."""

    def __init__(self, count: int, handler: Any, timeout_s: float) -> None:
        self._left, self._lock = count, threading.Lock()
        self._replies: queue.Queue[Any] = queue.Queue()
        self._until_s = time.monotonic() + timeout_s
        self.reply = self._replies.put if handler is None else handler
        if not count:
            self._replies.put(None)

    def drop(self) -> None:
        with self._lock:
            self._left -= 1
            if not self._left:
                self._replies.put(None)

    def __iter__(self) -> Iterator[Any]:
        while True:
            try:
                reply = self._replies.get(timeout=max(0.0, self._until_s - time.monotonic()))
            except queue.Empty:
                return
            if reply is None:
                return
            yield reply


class FakeSession:
    """A session, and the `info` and `liveliness()` of it."""

    def __init__(self, network: FakeZenoh, config: zenoh.Config, number: int) -> None:
        self.zenoh, self.number = network, number
        self.mode: str = json.loads(config.get_json("mode") or "null") or "peer"
        self.listen: list[str] = json.loads(config.get_json("listen/endpoints")) or []
        self.connect: list[str] = json.loads(config.get_json("connect/endpoints")) or []
        stamps = json.loads(config.get_json("timestamping/enabled"))
        self.stamps: bool = stamps is True or self.mode == "router"
        self.subscribers: list[Declared] = []
        self.queryables: list[Declared] = []
        self.tokens: list[Declared] = []
        self.token_subscribers: list[Declared] = []
        self.publishers: list[FakePublisher] = []
        self._transport_listeners: list[Callable[[Any], None]] = []
        self._linked: dict[str, FakeSession] = {}
        self.closed = False

    def zid(self) -> str:
        return f"{self.number:032x}".replace("0", "a", 1)

    @property
    def info(self) -> FakeSession:
        return self

    def liveliness(self) -> Any:
        return SimpleNamespace(
            declare_token=lambda key: self._declare(self.tokens, key, print),
            declare_subscriber=self._declare_token_subscriber,
            get=lambda key, timeout: [
                SimpleNamespace(ok=SimpleNamespace(key_expr=each))
                for each in self.visible_tokens(zenoh.KeyExpr(key))
            ],
        )

    def _declare_token_subscriber(self, key: str, handler: Any = None, **_: Any) -> Declared:
        return self._declare(self.token_subscribers, key, handler)

    def _declare(self, place: list[Any], key: str, handler: Any) -> Declared:
        self._check()
        declared = Declared(self, place, key, handler)
        self.zenoh.look()
        return declared

    def declare_subscriber(self, key: str, handler: Any = None) -> Declared:
        return self._declare(self.subscribers, key, handler)

    def declare_queryable(self, key: str, handler: Any, *, complete: bool = False) -> Declared:
        declared = self._declare(self.queryables, key, handler)
        declared.complete = complete
        return declared

    def declare_publisher(self, key: str, **options: Any) -> FakePublisher:
        self._check()
        self.publishers.append(FakePublisher(self, key, options))
        return self.publishers[-1]

    def declare_transport_events_listener(self, handler: Any, *, history: bool) -> None:
        assert history
        self._transport_listeners.append(handler.callback)
        for each in self._linked.values():
            handler.callback(_transport(each, PUT))

    def put(self, key: str, payload: bytes | str, **options: Any) -> None:
        self._send(key, payload, PUT, options)

    def delete(self, key: str, **options: Any) -> None:
        self._send(key, b"", DELETE, options)

    def _send(self, key: str, payload: Any, kind: Any, options: dict[str, Any]) -> None:
        self._check()
        reached = self.reach()
        stamper = next((each for each in reached if each.stamps), None)
        if kind == PUT and options.get("timestamp") is None and stamper is not None:
            options["timestamp"] = stamper.new_timestamp()
        sample = _sample(key, payload, kind, options)
        for session in reached:
            for subscriber in list(session.subscribers):
                if subscriber.on(sample.key_expr):
                    subscriber.call(sample)

    def get(self, selector: str, handler: Any = None, **options: Any) -> Asked:
        self._check()
        asked_for = zenoh.Selector(selector)
        services = [
            each
            for session in self.reach()
            for each in session.queryables
            if each.on(asked_for.key_expr)
        ]
        complete = [
            each
            for each in services
            if each.complete and each.key_expr.includes(asked_for.key_expr)
        ]
        if complete and options.get("target") != zenoh.QueryTarget.ALL:
            services = complete[:1]
        asked = Asked(len(services), handler, options.get("timeout", 10.0))
        for service in services:
            service.call(FakeQuery(asked_for, options, asked))
        return asked

    def new_timestamp(self) -> zenoh.Timestamp:
        seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
        own = int(self.zid(), 16).to_bytes(16, "little")
        return zenoh.Timestamp(zenoh.NTP64(seconds, nanoseconds), own)

    def _check(self) -> None:
        if self.closed:
            raise zenoh.ZError("the session is closed")

    def close(self) -> None:
        self.zenoh.close(self)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # What it is connected to.

    def links(self) -> list[Any]:
        return [
            SimpleNamespace(zid=each.zid(), src="tcp/127.0.0.1:1", dst=address)
            for address, each in self._linked.items()
        ]

    def transports(self) -> list[Any]:
        return [_transport(each, PUT).transport for each in self._linked.values()]

    def routers_zid(self) -> list[str]:
        return [each.zid() for each in self._linked.values() if each.mode == "router"]

    def reach(self) -> list[FakeSession]:
        """All sessions that it reaches, itself first and the nearest next."""
        found = [] if self.closed else [self]
        for session in found:
            found += [each for each in session._linked.values() if each not in found]
        return found

    def visible_tokens(self, key: zenoh.KeyExpr) -> set[str]:
        return {
            str(token.key_expr)
            for session in self.reach()
            for token in session.tokens
            if token.on(key)
        }

    def relink(self, linked: dict[str, FakeSession]) -> None:
        before, self._linked = self._linked, linked
        gone = [each for each in before.values() if each not in linked.values()]
        come = [each for each in linked.values() if each not in before.values()]
        for each, kind in [*((each, DELETE) for each in gone), *((each, PUT) for each in come)]:
            for listener in self._transport_listeners:
                listener(_transport(each, kind))

    def look(self) -> None:
        """Tell of tokens and subscribers that came or went."""
        for subscriber in self.token_subscribers:
            now = self.visible_tokens(subscriber.key_expr)
            changes = [(key, DELETE) for key in sorted(subscriber.seen - now)]
            changes += [(key, PUT) for key in sorted(now - subscriber.seen)]
            subscriber.seen = now
            for key, kind in changes:
                subscriber.call(_sample(key, b"", kind, {}))
        for publisher in self.publishers:
            publisher.look()


class FakeZenoh:
    """The sessions that are open; one reaches another by the endpoint that it listens on."""

    def __init__(self) -> None:
        self._sessions: list[FakeSession] = []
        self._numbers = itertools.count(1)
        self._lock = threading.RLock()

    def open(self, config: zenoh.Config) -> FakeSession:
        with self._lock:
            session = FakeSession(self, config, next(self._numbers))
            taken = self._listening()
            if used := [each for each in session.listen if each in taken]:
                raise zenoh.ZError(f"Address already in use: {used[0]}")
            if session.mode == "client" and not set(session.connect) & taken.keys():
                raise zenoh.ZError(f"Unable to connect to any of {session.connect}!")
            self._sessions.append(session)
            self._relink()
        return session

    def open_router(self, endpoint: str) -> FakeSession:
        config = zenoh.Config()
        config.insert_json5("mode", '"router"')
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        return self.open(config)

    def close(self, session: FakeSession) -> None:
        with self._lock:
            session.closed = True
            if session in self._sessions:
                self._sessions.remove(session)
            session.relink({})
            self._relink()

    def _listening(self) -> dict[str, FakeSession]:
        return {address: each for each in self._sessions for address in each.listen}

    def _relink(self) -> None:
        listening = self._listening()
        links: dict[FakeSession, dict[str, FakeSession]] = {each: {} for each in self._sessions}
        for session in self._sessions:
            found = [address for address in session.connect if address in listening]
            for address in found[:1] if session.mode == "client" else found:
                links[session][address] = listening[address]
                links[listening[address]][f"tcp/127.0.0.1:{40_000 + session.number}"] = session
        for session, linked in links.items():
            session.relink(linked)
        self.look()

    def look(self) -> None:
        with self._lock:
            for session in list(self._sessions):
                session.look()


def _bytes(data: bytes | str | None) -> zenoh.ZBytes | None:
    return None if data is None else zenoh.ZBytes(data)


def _sample(key: str, payload: bytes | str, kind: Any, options: dict[str, Any]) -> Any:
    return SimpleNamespace(
        **{
            **dict.fromkeys(("timestamp", "priority", "congestion_control", "express")),
            **options,
            "encoding": zenoh.Encoding(str(options.get("encoding") or "zenoh/bytes")),
            "key_expr": zenoh.KeyExpr(key),
            "payload": zenoh.ZBytes(payload),
            "attachment": _bytes(options.get("attachment")),
            "kind": kind,
        }
    )


def _transport(session: FakeSession, kind: Any) -> Any:
    transport = SimpleNamespace(zid=session.zid(), whatami=session.mode)
    return SimpleNamespace(kind=kind, transport=transport)


@pytest.fixture
def fake_zenoh(monkeypatch: pytest.MonkeyPatch) -> FakeZenoh:
    """Sessions in memory instead of Zenoh's, for all that this process opens."""
    fake = FakeZenoh()
    monkeypatch.setattr(zenoh, "open", fake.open)
    monkeypatch.setattr(zenoh, "Publisher", FakePublisher)
    for module in (subscriptions, streams):
        monkeypatch.setattr(module, "RingChannel", Ring)
    return fake
