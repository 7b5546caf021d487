from __future__ import annotations

import asyncio
from typing import Any

import pytest
from zenoh_fixtures import PATIENCE_S

from yahboomd.client.services import (
    Answer,
    ask,
    ask_urgently,
    read_answers,
    silence_of,
    which_count,
)
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


YES = encode(ServiceReply(success=True, message="Engaged."), "json")
NO = encode(ServiceReply(success=False, message="Too many requests at once."), "json")


@pytest.mark.parametrize(
    ("named", "common", "count"),
    [
        ([YES], [YES], "named"),
        ([YES], [], "named"),
        ([NO], [], "named"),
        ([], [YES], "common"),
        ([YES], [YES, YES], "common"),
        ([NO], [YES], "common"),
        ([YES], [NO], "named"),
        ([NO], [NO], "common"),
    ],
)
def test_a_stop_that_is_acknowledged_on_one_of_its_keys_is_no_refusal(
    named: list[bytes], common: list[bytes], count: str
) -> None:
    assert which_count(named, common) is (named if count == "named" else common)


def test_no_answer_on_either_key_is_none() -> None:
    assert which_count([], []) == []


async def asked(us: Bus) -> Answer:
    return read_answers(await ask(us.session, keys.ESTOP, urgent=True))


@pytest.mark.usefixtures("fake_zenoh")
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


@pytest.mark.usefixtures("fake_zenoh")
async def test_a_service_without_a_server_answers_nothing(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with client(daemon.endpoint) as us:
        assert await ask(us.session, "yahboomd/nothing") == []


@pytest.mark.usefixtures("fake_zenoh")
async def test_keys_that_are_asked_at_once_do_not_wait_for_each_other(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    last_came = asyncio.Event()
    yes = Response(payload=YES)

    async def once_the_last_came(_: object) -> Response:
        await last_came.wait()
        return yes

    def last(_: object) -> Response:
        last_came.set()
        return yes

    async with client(daemon.endpoint) as other, client(daemon.endpoint) as us:
        other.serve("first", once_the_last_came, fallback=lambda *_: yes)
        other.serve("last", last, fallback=lambda *_: yes)
        async with asyncio.timeout(PATIENCE_S):
            # They become known in this order.
            while not await ask(us.session, "last"):
                await asyncio.sleep(0.01)
        last_came.clear()
        keys_in_full = ("first", "last")
        found = await ask_urgently(us.session, keys_in_full, b"{}", timeout_s=PATIENCE_S)
    assert found == [[YES], [YES]]


@pytest.mark.usefixtures("fake_zenoh")
async def test_a_key_that_cannot_be_asked_or_that_nothing_knows_keeps_no_other_from_being_asked(
    fake_daemon: Any,
) -> None:
    daemon = await fake_daemon()
    async with client(daemon.endpoint) as us:
        keys_in_full = ("/?", "unknown", keys.ESTOP)
        found = await ask_urgently(us.session, keys_in_full, b"{}", timeout_s=PATIENCE_S)
    assert [len(each) for each in found] == [0, 0, 1]
    assert daemon.asked == [keys.ESTOP]
