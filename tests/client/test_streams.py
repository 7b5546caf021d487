"""Samples of either encoding and of none, and the losses of a slow reader."""

from __future__ import annotations

import asyncio
from typing import Any
from unittest.mock import Mock

import daemon_samples
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from make.schema_files import cdr_samples, samples
from make.schema_files.samples import MESSAGES
from yahboomd.client.streams import KEYS, Samples, depth_of, read_sample
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.subscriptions import Arrival
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import EventSample, PoseSample, StatusSample


@pytest.mark.parametrize("encoding", ["json", "msgpack"])
@pytest.mark.parametrize("name", ["PoseSample", "StatusSample", "EventSample", "ServiceReply"])
def test_either_encoding_reads_as_the_same_sample(name: str, encoding: str) -> None:
    sample = samples.NATIVE[name]
    assert read_sample(encode(sample, encoding), MESSAGES[name]) == sample


def test_fields_of_a_later_version_are_ignored() -> None:
    fields = {**msgspec.to_builtins(samples.NATIVE["PoseSample"]), "altitude": 1.0}
    assert read_sample(msgspec.json.encode(fields), PoseSample) == samples.NATIVE["PoseSample"]


def test_another_message_is_not_taken_for_the_one_that_is_expected() -> None:
    assert read_sample(encode(samples.NATIVE["PoseSample"], "json"), StatusSample) is None


def test_cdr_is_nothing_that_a_native_key_carries() -> None:
    assert read_sample(cdr_samples.CDR["Odometry"].payload, PoseSample) is None


@given(st.binary())
def test_no_bytes_raise(payload: bytes) -> None:
    assert read_sample(payload, PoseSample) is None
    assert read_sample(b"{" + payload, StatusSample) is None
    assert read_sample(b"\x81" + payload, StatusSample) is None


def test_brackets_without_end_do_not_raise() -> None:
    assert read_sample(b'{"board":' * 100_000, StatusSample) is None


@pytest.mark.parametrize("name", ["StatusSample", "EventSample", "ServiceReply"])
def test_words_of_a_foreign_publisher_cannot_command_a_terminal(name: str) -> None:
    field = "why" if name == "StatusSample" else "message"
    foreign = msgspec.structs.replace(samples.NATIVE[name], **{field: "\x1b[2J\x1b]0;mine\x07"})
    sample = read_sample(encode(foreign, "json"), MESSAGES[name])
    assert getattr(sample, field).isprintable()


def arrival(seq: int, *, dropped: int = 0) -> Arrival:
    payload = encode(daemon_samples.pose(seq=seq), "json")
    return Arrival(key="", payload=payload, stamp_ns=None, arrived_ns=0, dropped=dropped)


def stream_of(depth: int, *taken: Any) -> Samples[PoseSample]:
    return Samples(Mock(spec=Bus), PoseSample, depth, *taken)


async def test_samples_come_in_order_and_end_after_what_is_kept() -> None:
    stream = stream_of(8)
    stream.receive([arrival(1), arrival(2)])
    stream.close()
    assert [sample.seq async for sample in stream] == [1, 2]


async def test_a_slow_reader_gets_the_newest_and_the_losses_are_counted() -> None:
    stream = stream_of(2)
    stream.receive([arrival(1, dropped=3), arrival(2), arrival(3)])
    stream.close()
    assert [sample.seq async for sample in stream] == [2, 3]
    assert stream.dropped == 4


async def test_the_arrival_of_each_sample_that_a_reader_takes_is_handed_on() -> None:
    taken: list[int] = []
    stream = stream_of(2, taken.append)
    stream.receive([structs.replace(arrival(1), arrived_ns=5), arrival(2)])
    await anext(stream)
    assert taken == [5]


def test_the_newest_is_kept_of_all_but_events() -> None:
    assert {message: depth_of(message, None) for message in KEYS} == {
        **dict.fromkeys(KEYS, 1),
        EventSample: 64,
    }
    assert depth_of(PoseSample, 9) == 9


async def test_what_is_no_such_message_is_counted() -> None:
    stream = stream_of(8)
    stream.receive([Arrival(key="", payload=b"{}", stamp_ns=None, arrived_ns=0)])
    assert stream.unreadable == 1


async def test_a_reader_that_waits_is_woken_by_a_sample_and_by_the_end() -> None:
    bus = Mock(spec=Bus)
    stream = Samples(bus, PoseSample, 8)
    reading = asyncio.create_task(anext(stream))
    await asyncio.sleep(0)
    stream.receive([arrival(5)])
    assert (await reading).seq == 5
    waiting = asyncio.create_task(anext(stream, None))
    await asyncio.sleep(0)
    stream.close()
    stream.close()
    assert await waiting is None
    bus.subscribe.return_value.close.assert_called_once()
    with pytest.raises(StopAsyncIteration):
        await anext(stream)
