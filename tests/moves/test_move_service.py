"""The service on a real bus, between clients and what looks like a daemon."""

from __future__ import annotations

import asyncio
import json
import os
import time
from collections.abc import AsyncIterator, Callable
from random import Random
from typing import Any

import msgspec
import pytest
from fake_daemon import fake_daemon
from zenoh_fixtures import eventually

from yahboomd.client import AsyncRobot, connect
from yahboomd.client.move_messages import BEAT, CANCEL, MOVES, PAUSE, RESUME, SOURCE, START
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.clock import SystemClock
from yahboomd.core.config import read
from yahboomd.core.errors import Refused
from yahboomd.moves import move_keeper, move_service
from yahboomd.moves.motion import move_watch
from yahboomd.moves.move_service import MoveService

__all__ = ["fake_daemon"]

pytestmark = pytest.mark.realtime

STRAIGHT = b'{"moves": [{"kind": "straight", "distance_m": 1.0}], "by": "a test"}'


@pytest.fixture
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a busy machine poses come late."""
    monkeypatch.setattr(move_keeper, "POSE_S", 60.0)
    monkeypatch.setattr(move_keeper, "OBEYS_S", 600.0)
    # The daemon's base stands, whatever it is commanded.
    monkeypatch.setattr(move_watch, "BLOCKED_S", 600.0)
    # No other service is there.
    monkeypatch.setattr(move_service, "SETTLE_S", 0.05)


@pytest.fixture
async def served(
    fake_daemon: Callable[..., Any], patience: None
) -> AsyncIterator[tuple[Any, AsyncRobot, MoveService]]:
    """A daemon, a client, and the service, which knows the daemon."""
    config = read(None, environ={}).config.resolved().as_data()
    config["command"]["timeout_s"] = 60.0
    config["command"]["sources"][SOURCE]["timeout_s"] = 60.0
    daemon = await fake_daemon(config=config)
    async with connect(daemon.endpoint) as robot:
        service = MoveService(robot._connection.options, SystemClock())
        running = asyncio.create_task(service.run())

        async def ready() -> bool:
            answer = await robot.request(PAUSE)
            return answer.answered == 1 and service._keeper.knows_base

        while not (await ready() and service._keeper._pose is not None):
            await asyncio.sleep(0.05)
        yield daemon, robot, service
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


def moving(daemon: Any) -> bool:
    return any(command["vx"] for command in daemon.commands)


class OffClock(SystemClock):
    """A machine whose wall clock is wrong."""

    def __init__(self, hours: float) -> None:
        self._off_ns = round(hours * 3600e9)

    def wall_ns(self) -> int:  # type: ignore[override]
        return time.time_ns() + self._off_ns


@pytest.mark.parametrize(
    "hours",
    [
        pytest.param(0.0, marks=pytest.mark.nightly),
        -20.0,
        pytest.param(20.0, marks=pytest.mark.nightly),
    ],
)
async def test_a_second_service_of_one_robot_ends_in_words_and_the_first_drives_on(
    served: Any, monkeypatch: pytest.MonkeyPatch, hours: float
) -> None:
    _, robot, service = served
    monkeypatch.setattr(move_service, "SETTLE_S", 0.5)
    monkeypatch.setattr(move_keeper, "SILENCE_S", 60.0)
    assert (await robot.request(START, STRAIGHT)).success
    second = MoveService(robot._connection.options, OffClock(hours))
    with pytest.raises(Refused, match="serves this robot already"):
        await second.run()
    assert not second.serving
    assert (await robot.request(PAUSE)).answered == 1
    assert service._keeper.last.state == "paused"


async def test_of_services_that_start_at_once_one_serves(
    fake_daemon: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(move_service, "SETTLE_S", 0.5)
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        services = [MoveService(robot._connection.options, SystemClock()) for _ in range(3)]
        running = [asyncio.create_task(each.run()) for each in services]
        await eventually(lambda: sum(each.done() for each in running) == 2)
        await eventually(lambda: any(each.serving for each in services))
        assert (await robot.request(PAUSE)).answered == 1
        for task in running:
            task.cancel()
        ends = await asyncio.gather(*running, return_exceptions=True)
        assert sum(isinstance(end, Refused) for end in ends) == 2


async def test_a_client_of_any_language_has_a_move_driven_and_cancels_it(served: Any) -> None:
    daemon, robot, _ = served
    begun = await robot.request(START, STRAIGHT)
    assert begun.success, begun.message
    name = begun.data["id"]
    beat = json.dumps({"id": name}).encode()
    for _ in range(600):
        robot.bus.session.put(BEAT, beat)
        await asyncio.sleep(0.02)
        if moving(daemon):
            break
    assert moving(daemon)
    assert all(command["source"] == "yahboomd moves" for command in daemon.commands)
    progress = json.loads((await robot.ask(MOVES))[0])
    assert (progress["id"], progress["state"], progress["by"]) == (name, "running", "a test")
    assert (await robot.request(PAUSE, beat)).success
    assert (await robot.request(RESUME)).success
    assert (await robot.request(CANCEL, b"")).message == f"Moves {name} are cancelled."
    await eventually(lambda: daemon.commands[-1]["vx"] == 0.0)
    ended = json.loads((await robot.ask(MOVES))[0])
    assert (ended["state"], ended["reason"]) == ("ended", "cancelled")
    assert ended["stamp_ns"] > 1e18


async def test_a_client_that_sends_no_beats_is_over_soon(served: Any) -> None:
    _, robot, service = served
    assert (await robot.request(START, STRAIGHT)).success
    await eventually(lambda: service._keeper.last and service._keeper.last.state == "ended")
    assert service._keeper.last.reason == "client_silent"


async def test_a_token_that_goes_ends_the_moves(served: Any) -> None:
    daemon, robot, service = served
    async with connect(daemon.endpoint) as other:
        seen: list[Any] = []
        robot.bus.watch_tokens("yahboomd/moves/holder/*", seen.extend)
        token = other.bus.session.liveliness().declare_token("yahboomd/moves/holder/tok")
        request = json.loads(STRAIGHT) | {"holder": "tok"}
        begun = await robot.request(START, json.dumps(request).encode())
        beat = json.dumps({"id": begun.data["id"]}).encode()

        async def beats() -> None:
            while True:
                robot.bus.session.put(BEAT, beat)
                await asyncio.sleep(0.05)

        beating = asyncio.create_task(beats())
        await eventually(lambda: seen)
        token.undeclare()
        await eventually(lambda: service._keeper.last.state == "ended")
        beating.cancel()
        assert service._keeper.last.reason == "client_gone"


async def test_a_token_that_no_service_has_ends_nothing(served: Any) -> None:
    _, robot, service = served
    async with connect(served[0].endpoint) as other:
        declare = other.bus.session.liveliness().declare_token
        tokens = [declare(f"yahboomd/moves/serving/{name}") for name in ("0", "00", "0-", "0-zz")]
        seen: list[Any] = []
        robot.bus.watch_tokens("yahboomd/moves/serving/*", seen.extend)
        await eventually(lambda: len(seen) > len(tokens))
        service._look_for_others(0)
        assert service.serving


async def test_a_flood_of_beats_does_not_starve_the_client_that_is_there(served: Any) -> None:
    _, robot, service = served
    request = json.loads(STRAIGHT) | {"holder": "tok"}
    begun = await robot.request(START, json.dumps(request).encode())
    running = service._keeper._running
    before_ns = running.beat_ns
    foreign = Arrival(
        key=BEAT, payload=b'{"id": "x"}', stamp_ns=None, arrived_ns=before_ns + 7, dropped=0
    )
    service._beat([foreign])
    assert running.beat_ns == before_ns
    # The lane was full: the client's own may be among those that were lost.
    service._beat([msgspec.structs.replace(foreign, dropped=1000)])
    assert running.beat_ns == before_ns + 7
    running.holder = ""
    service._beat([msgspec.structs.replace(foreign, dropped=1000, arrived_ns=before_ns + 9)])
    assert running.beat_ns == before_ns + 7
    assert begun.success


async def test_no_request_raises_or_moves_anything(served: Any) -> None:
    daemon, robot, _ = served
    for payload, words in (
        (b"", "neither JSON nor MessagePack"),
        (b"hello", "neither JSON nor MessagePack"),
        (b"{", "cannot be read"),
        (b'{"moves": []}', "cannot be read"),
        (b'{"moves": [{"kind": "fly"}]}', "cannot be read"),
        (b'{"moves": [{"kind": "straight", "distance_m": 1e9}]}', "cannot be read"),
        (b'{"moves": [{"kind": "straight", "left_m": 1}]}', "mecanum"),
        (b'{"moves": ' + b"[" * 10_000, "cannot be read"),
        (b'{"moves": [{"kind": "turn"}], "pad": "' + b"x" * 70_000 + b'"}', ""),
    ):
        answer = await robot.request(START, payload)
        assert not answer.success
        assert words in answer.message
        assert not (await robot.request(CANCEL, payload or b"[")).success
    assert daemon.commands == []


async def test_a_daemon_that_goes_ends_the_moves_and_they_do_not_go_on_when_it_is_back(
    served: Any,
) -> None:
    daemon, robot, service = served
    assert (await robot.request(START, STRAIGHT)).success
    await daemon.stop()
    await eventually(lambda: service._keeper.last.state == "ended")
    await eventually(lambda: not service.robot.alive)
    assert service._keeper.last.reason in {"daemon_lost", "client_silent"}
    daemon.commands.clear()
    await daemon.start()
    await eventually(lambda: service._keeper.knows_base)
    assert not moving(daemon)


@pytest.mark.nightly
async def test_random_messages_move_nothing_and_end_no_move_of_another(served: Any) -> None:
    daemon, robot, service = served
    count = int(os.environ.get("YAHBOOMD_RANDOM_MESSAGES", "200"))
    chance = Random(1)
    parts = (b'{"id": "', b'"moves": [', b"{}", b'"kind": "straight"', b"1e999", b"\x81\xa2id\xc0")
    parts += (b"NaN", b'{"moves": [{"kind": "turn", "angle_rad": NaN}]}', b"\xff\x00", b"[" * 999)

    def payload() -> bytes:
        return b"".join(chance.choices(parts, k=chance.randrange(4))) + chance.randbytes(
            chance.randrange(40)
        )

    for number in range(count):
        key = chance.choice((BEAT, START, CANCEL, PAUSE, RESUME, MOVES))
        if chance.random() < 0.8:
            robot.bus.session.put(key, payload())
        elif key in {START, CANCEL, PAUSE, RESUME}:
            # Without a payload they would be requests that mean something.
            answer = await robot.request(key, b"\xc1" + payload())
            assert not answer.success
        if number % 500 == 0:
            await asyncio.sleep(0)
    assert daemon.commands == []
    begun = await robot.request(START, STRAIGHT)
    assert begun.success, begun.message
    name = begun.data["id"]
    for _ in range(20):
        robot.bus.session.put(BEAT, json.dumps({"id": name}).encode())
        for key in (BEAT, CANCEL, PAUSE, START):
            robot.bus.session.put(key, payload())
        assert not (await robot.request(CANCEL, b'{"id": "another"}')).success
        assert not (await robot.request(START, STRAIGHT)).success
    assert service._keeper.last.state == "running"
    assert (await robot.request(CANCEL, json.dumps({"id": name}).encode())).success
