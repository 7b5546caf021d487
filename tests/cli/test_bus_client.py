from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest
from zenoh_fixtures import eventually, free_endpoint

from yahboomd.bus import keys
from yahboomd.bus.options import BusOptions
from yahboomd.bus.services import Response
from yahboomd.bus.session import Bus
from yahboomd.cli.bus_client import BusClient, client_options, reach, read_answers
from yahboomd.config import load
from yahboomd.errors import BusError
from yahboomd.messages.codecs import encode
from yahboomd.messages.native import ServiceReply


def options(endpoint: str) -> BusOptions:
    return BusOptions(mode="client", listen=(), connect=(endpoint,))


def test_a_client_listens_nowhere_and_takes_namespace_and_file_from_the_configuration(
    tmp_path: Path,
) -> None:
    (tmp_path / "zenoh.json5").write_text("{}")
    config = load(
        None,
        environ={},
        overrides=["zenoh.namespace=bot1", f"zenoh.config={tmp_path / 'zenoh.json5'}"],
    )
    made = client_options(("tcp/10.0.0.1:7447",), config)
    assert made.mode == "client"
    assert made.listening == ()
    assert made.connect == ("tcp/10.0.0.1:7447",)
    assert made.namespace == "bot1"
    assert made.config_file == tmp_path / "zenoh.json5"
    assert not made.enforces


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


def test_no_answer_is_no_success() -> None:
    answer = read_answers([])
    assert (answer.success, answer.answered) == (False, 0)
    assert answer.message == "Nobody answered."


@pytest.mark.realtime
async def test_a_service_answers_a_client(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with BusClient(options(daemon.endpoint)) as client:
        answer = await client.request(keys.ESTOP, urgent=True)
    assert answer.success
    assert answer.message == "The emergency stop is engaged."
    assert daemon.asked == [keys.ESTOP]


@pytest.mark.realtime
async def test_every_daemon_is_asked_not_the_nearest_alone(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    reply = Response(payload=encode(ServiceReply(success=True, message="Me too."), "json"))
    async with Bus(options(daemon.endpoint)) as other, BusClient(options(daemon.endpoint)) as us:
        other.serve(keys.ESTOP, lambda _: reply, fallback=lambda *_: reply)
        for _ in range(100):
            # What the other serves has to become known first.
            if (answer := await us.request(keys.ESTOP)).answered == 2:
                break
    assert answer.answered == 2
    assert "The emergency stop is engaged." in answer.message
    assert "Me too." in answer.message


@pytest.mark.realtime
async def test_a_service_that_nobody_serves_answers_nothing(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with BusClient(options(daemon.endpoint)) as client:
        assert await client.ask("yahboomd/nothing") == []


@pytest.mark.realtime
async def test_the_newest_sample_waits_for_whoever_looks(fake_daemon: Any) -> None:
    daemon = await fake_daemon()
    async with BusClient(options(daemon.endpoint)) as client:
        take = client.newest(keys.POSE)
        first = await eventually(take)
        second = await eventually(take)
    assert first != second


@pytest.mark.realtime
async def test_a_daemon_that_comes_later_is_reached(fake_daemon: Any) -> None:
    endpoint = free_endpoint()
    said: list[str] = []
    reaching = asyncio.create_task(reach(options(endpoint), waiting=said.append))
    await eventually(lambda: said)
    assert endpoint in said[0]
    await fake_daemon(endpoint=endpoint)
    client = await reaching
    assert await client.ask(keys.ESTOP)
    await client.close()


@pytest.mark.realtime
async def test_an_endpoint_that_can_never_work_is_not_waited_for() -> None:
    with pytest.raises(BusError, match="cannot be used"):
        await reach(options("nonsense"))
