from __future__ import annotations

import asyncio

import daemon_samples
import pytest

from yahboomd.bus.subscriptions import Arrival
from yahboomd.client.streams import Samples
from yahboomd.messages.codecs import encode
from yahboomd.messages.native import PoseSample


def arrival(seq: int, *, dropped: int = 0) -> Arrival:
    payload = encode(daemon_samples.pose(seq=seq), "json")
    return Arrival(key="", payload=payload, stamp_ns=None, arrived_ns=0, dropped=dropped)


async def test_samples_come_in_order_and_end_after_what_is_kept() -> None:
    stream = Samples(PoseSample, 8)
    stream.receive([arrival(1), arrival(2)])
    stream.close()
    assert [sample.seq async for sample in stream] == [1, 2]


async def test_a_slow_reader_gets_the_newest_and_the_losses_are_counted() -> None:
    stream = Samples(PoseSample, 2)
    stream.receive([arrival(1, dropped=3), arrival(2), arrival(3)])
    stream.close()
    assert [sample.seq async for sample in stream] == [2, 3]
    assert stream.dropped == 4


async def test_what_is_no_such_message_is_counted() -> None:
    stream = Samples(PoseSample, 8)
    stream.receive([Arrival(key="", payload=b"{}", stamp_ns=None, arrived_ns=0)])
    assert stream.unreadable == 1


async def test_a_reader_that_waits_is_woken_by_a_sample_and_by_the_end() -> None:
    stream = Samples(PoseSample, 8)
    ends: list[str] = []
    stream.attach(lambda: ends.append("ended"))
    reading = asyncio.create_task(anext(stream))
    await asyncio.sleep(0)
    stream.receive([arrival(5)])
    assert (await reading).seq == 5
    waiting = asyncio.create_task(anext(stream, None))
    await asyncio.sleep(0)
    stream.close()
    stream.close()
    assert await waiting is None
    assert ends == ["ended"]
    with pytest.raises(StopAsyncIteration):
        await anext(stream)
