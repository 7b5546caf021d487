from __future__ import annotations

import asyncio
from typing import Any

import pytest
from zenoh_fixtures import PATIENCE_S

from yahboomd.client.questions import Answer, ask, read_answers, silence_of
from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.services import Response
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import ServiceReply


def client(endpoint: str) -> Bus:
    return Bus(BusOptions(mode="client", listen=(), connect=(endpoint,)))


def test_several_answers_are_a_success_only_together() -> None:
    yes = encode(ServiceReply(success=True, message="Stopped."), "json")
    no = encode(ServiceReply(success=False, message="Not me."), "msgpack")
    assert read_answers([yes, yes]).success
    assert read_answers([yes, yes]).message == "Stopped."
    both = read_answers([yes, no])
    assert (both.success, both.message, both.answered) == (False, "Stopped. Not me.", 2)


def test_an_answer_that_cannot_be_read_is_no_success() -> None:
    answer = read_answers([b"\x00"])
    assert not answer.success
    assert answer.answered == 1


@pytest.mark.parametrize(
    ("command", "silence_s"),
    [
        ({"timeout_s": 0.7}, 0.7),
        ({"timeout_s": 0.7, "sources": {"cmd_vel": {"timeout_s": None}}}, 0.7),
        ({"timeout_s": 0.7, "sources": {"cmd_vel": {"timeout_s": 2}, "other": {}}}, 2.0),
        ({"timeout_s": "soon", "sources": []}, None),
        (7, None),
    ],
)
def test_the_silence_of_a_source_is_read_from_the_configuration(
    command: Any, silence_s: float | None
) -> None:
    reply = ServiceReply(success=True, message="", data={"command": command})
    assert silence_of([encode(reply, "json")], "cmd_vel") == silence_s
    least = ServiceReply(success=True, message="", data={"command": {"timeout_s": 0.25}})
    assert silence_of([encode(reply, "json"), encode(least, "msgpack")], "cmd_vel") == 0.25


def test_a_daemon_that_answers_something_else_tells_no_silence() -> None:
    assert silence_of([], "cmd_vel") is None
    assert silence_of([b"\x00", b"{}"], "cmd_vel") is None


def test_no_answer_is_no_success() -> None:
    answer = read_answers([])
    assert (answer.success, answer.answered) == (False, 0)
    assert answer.message == "No daemon answered."


async def asked(us: Bus) -> Answer:
    return read_answers(await ask(us.session, keys.ESTOP, urgent=True))


@pytest.mark.realtime
async def test_every_daemon_is_asked_not_the_nearest_alone(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    reply = Response(payload=encode(ServiceReply(success=True, message="Me too."), "json"))
    async with client(daemon.endpoint) as other, client(daemon.endpoint) as us:
        other.serve(keys.ESTOP, lambda _: reply, fallback=lambda *_: reply)
        async with asyncio.timeout(PATIENCE_S):
            # The other's services have to become known first.
            while (answer := await asked(us)).answered < 2:
                await asyncio.sleep(0.01)
    assert "The emergency stop is engaged." in answer.message
    assert "Me too." in answer.message


@pytest.mark.realtime
async def test_a_service_without_a_server_answers_nothing(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with client(daemon.endpoint) as us:
        assert await ask(us.session, "yahboomd/nothing") == []
