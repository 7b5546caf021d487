"""Moves for this client: asked for, kept alive, followed, ended."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest
from fake_moves import FakeMoves
from zenoh_fixtures import eventually

from yahboomd.client import Move, MoveEnded, NoDaemon, Refused, connect, robot_moves
from yahboomd.client.move_messages import CANCEL, PAUSE, RESUME, START
from yahboomd.client.robot_moves import MoveRun
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.messages.native import ServiceReply

pytestmark = pytest.mark.usefixtures("fake_zenoh")

TURN = Move(kind="turn", angle_rad=1.0)


@pytest.fixture
async def moves(fake_daemon: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> Any:
    """The service beside a daemon, and a robot that is connected to both."""
    monkeypatch.setattr(robot_moves, "SERVICE_S", 60.0)
    daemon = await fake_daemon()
    bus = Bus(BusOptions(listen=(), connect=(daemon.endpoint,)))
    await bus.open()
    served = FakeMoves(bus)
    async with connect(daemon.endpoint, label="a test") as robot:
        while (await robot.ask(PAUSE)) == []:
            await asyncio.sleep(0.02)
        served.asked.clear()
        served.requests.clear()
        yield served, robot
    await bus.close()


async def test_a_move_is_asked_for_kept_alive_and_awaited(moves: Any) -> None:
    served, robot = moves
    driving = asyncio.create_task(robot.turn(degrees=90, turn_rad_s=0.5))
    await eventually(lambda: len(served.beats) > 3)
    (request,) = served.requests
    assert request["by"] == "a test"
    (move,) = request["moves"]
    assert move == {"kind": "turn", "angle_rad": pytest.approx(1.5708, abs=1e-4), "turn_rad_s": 0.5}
    assert served.tokens == {request["holder"]}
    assert set(served.beats) == {"m1"}
    served.tell(state="ended", reason="reached")
    assert (await driving).reason == "reached"
    await eventually(lambda: not served.tokens)
    assert served.asked == [START]


async def test_a_service_that_becomes_known_a_moment_later_is_asked_again(
    fake_daemon: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_moves, "KNOWN_S", 60.0)
    daemon = await fake_daemon()
    bus = Bus(BusOptions(listen=(), connect=(daemon.endpoint,)))
    await bus.open()
    served: list[FakeMoves] = []
    async with connect(daemon.endpoint) as robot:
        ask = robot.request

        async def request(*arguments: Any, **options: Any) -> Any:
            answer = await ask(*arguments, **options)
            if not served:
                assert not answer.answered
                served.append(FakeMoves(bus))
            return answer

        monkeypatch.setattr(robot, "request", request)
        async with robot.moves(TURN) as run:
            assert run.id == "m1"
    await bus.close()


async def test_one_that_ends_before_its_goal_raises_with_the_reason(moves: Any) -> None:
    served, robot = moves
    driving = asyncio.create_task(robot.straight(1.0))
    await eventually(lambda: served.beats)
    served.tell(state="ended", reason="blocked", message="It does not move.")
    with pytest.raises(MoveEnded, match="It does not move") as caught:
        await driving
    assert caught.value.reason == "blocked"


async def test_leaving_the_block_ends_the_moves(moves: Any) -> None:
    served, robot = moves
    seen: list[float] = []
    async with robot.moves(TURN, TURN) as run:
        served.tell(done=0.25)
        async for progress in run:
            seen.append(progress.done)
            break
        await eventually(lambda: served.beats)
    assert seen == [0.25]
    assert served.asked == [START, CANCEL]
    assert served.requests[-1] == {"id": "m1"}
    await eventually(lambda: not served.tokens)
    assert run._beating is None
    with pytest.raises(MoveEnded, match="This program ended"):
        await run.finished()


async def test_progress_ends_with_the_moves(moves: Any) -> None:
    served, robot = moves
    async with robot.moves(TURN) as run:
        served.tell(id="other", done=0.9)
        served.tell(done=0.5)
        served.tell(state="ended", reason="estop", done=0.5)
        states = [each.state async for each in run]
        assert states[-1] == "ended"
        with pytest.raises(MoveEnded) as caught:
            await run.finished()
    assert caught.value.reason == "estop"
    assert CANCEL not in served.asked


async def test_a_cancelled_program_and_a_robot_that_is_left_end_them(moves: Any) -> None:
    served, robot = moves
    driving = asyncio.create_task(robot.go_to(1.0, 2.0))
    await eventually(lambda: served.beats)
    driving.cancel()
    await asyncio.gather(driving, return_exceptions=True)
    assert served.asked == [START, CANCEL]
    run = robot.moves(TURN)
    await run.start()
    await robot.close()
    assert served.asked == [START, CANCEL, START, CANCEL]


async def test_pause_and_resume_name_the_moves(moves: Any) -> None:
    served, robot = moves
    async with robot.moves(TURN) as run:
        await run.pause()
        await run.resume()
        assert served.asked[1:] == [PAUSE, RESUME]
        served.answer = ServiceReply(success=False, message="No moves are being driven.")
        with pytest.raises(Refused, match="No moves"):
            await run.pause()


async def test_a_refusal_is_raised_in_the_words_of_the_service(moves: Any) -> None:
    served, robot = moves
    served.answer = ServiceReply(success=False, message="A car does not turn in place.")
    with pytest.raises(Refused, match="A car does not turn"):
        await robot.turn(1.0)
    await eventually(lambda: not served.tokens)


async def test_without_the_service_the_error_says_how_to_start_it(
    fake_daemon: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_moves, "ASK_S", 0.3)
    daemon = await fake_daemon()
    async with connect(daemon.endpoint) as robot:
        with pytest.raises(NoDaemon, match="`yahboomd moves`"):
            await robot.straight(1.0)


async def test_a_service_that_falls_silent_is_gone(
    moves: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, robot = moves
    monkeypatch.setattr(robot_moves, "SERVICE_S", 0.3)
    with pytest.raises(NoDaemon, match="is gone"):
        await robot.straight(1.0)


async def test_some_moves_are_needed() -> None:
    with pytest.raises(ValueError, match="1 to 100"):
        MoveRun(None, ())  # type: ignore[arg-type]
