"""From any thread to the loop: bounded, urgent first, sizes seen before."""

import asyncio
import os
import threading

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from yahboomd.core.bus.inbox import Inbox, SampleLane


@pytest.fixture
async def inbox():
    inbox = Inbox()
    yield inbox
    inbox.close()


async def test_everything_pending_comes_in_one_batch_in_order(inbox, turns):
    batches = []
    lane = inbox.lane(lambda batch, lost: batches.append((batch, lost)))
    for number in range(10):
        lane.offer(number)
    await turns()
    assert batches == [(list(range(10)), 0)]


async def test_newest_stay_when_a_lane_is_full_and_the_loss_is_counted(inbox, turns):
    batches = []
    lane = inbox.lane(lambda batch, lost: batches.append((batch, lost)), depth=4)
    for number in range(10):
        lane.offer(number)
    await turns()
    lane.offer(10)
    await turns()
    assert batches == [([6, 7, 8, 9], 6), ([10], 0)]
    assert (lane.counters.received, lane.counters.dropped) == (11, 6)


async def test_a_lane_that_refuses_hands_back_the_newest(inbox, turns):
    refused, batches = [], []
    lane = inbox.lane(lambda batch, lost: batches.append(batch), depth=2, refuse=refused.append)
    for number in range(4):
        lane.offer(number)
    await turns()
    assert (batches, refused) == ([[0, 1]], [2, 3])


async def test_urgent_entries_overtake_all_that_arrived_before_them(inbox, turns):
    order = []
    ordinary = [inbox.lane(lambda batch, lost: order.extend(batch)) for _ in range(3)]
    urgent = inbox.lane(lambda batch, lost: order.extend(batch), urgent=True)
    for lane in ordinary:
        for number in range(50):
            lane.offer(number)
    urgent.offer("stop")
    await turns()
    assert order[0] == "stop"
    assert len(order) == 151


async def test_urgent_entry_waits_for_one_batch_at_most(inbox, turns):
    order = []

    def handle(batch, lost):
        order.extend(batch)
        if len(order) == 50:
            urgent.offer("stop")

    ordinary = [inbox.lane(handle) for _ in range(3)]
    urgent = inbox.lane(lambda batch, lost: order.extend(batch), urgent=True)
    for lane in ordinary:
        for number in range(50):
            lane.offer(number)
    await turns()
    assert order.index("stop") == 50


async def test_a_lane_that_never_runs_dry_leaves_the_loop_its_turns(inbox):
    seen = 0

    def handle(batch, lost):
        nonlocal seen
        seen += len(batch)
        if seen < 10_000:
            lane.offer(seen)

    lane = inbox.lane(handle)
    lane.offer(0)
    other = []
    asyncio.get_running_loop().call_later(0, other.append, "ran")
    while not other:
        await asyncio.sleep(0)
    assert seen < 10_000


async def test_a_failing_handler_is_reported_and_keeps_no_other_lane_waiting(inbox, turns):
    reported, delivered = [], []
    asyncio.get_running_loop().set_exception_handler(
        lambda loop, context: reported.append(context["exception"])
    )

    def fail(batch, lost):
        raise ValueError("broken handler")

    first = inbox.lane(fail)
    second = inbox.lane(lambda batch, lost: delivered.extend(batch))
    first.offer(1)
    second.offer(2)
    await turns()
    first.offer(3)
    second.offer(4)
    await turns()
    assert delivered == [2, 4]
    assert [str(error) for error in reported] == ["broken handler", "broken handler"]


async def test_entries_of_many_threads_all_arrive_each_threads_in_order(inbox):
    got = []
    lane = inbox.lane(lambda batch, lost: got.extend(batch), depth=100_000)

    def offer(name):
        for number in range(500):
            lane.offer((name, number))

    threads = [threading.Thread(target=offer, args=(name,)) for name in range(4)]
    for thread in threads:
        thread.start()
    while len(got) < 2_000:
        await asyncio.sleep(0.001)
    for thread in threads:
        thread.join()
    for name in range(4):
        assert [number for who, number in got if who == name] == list(range(500))


async def test_nothing_is_delivered_after_a_lane_was_removed(inbox, turns):
    got = []
    lane = inbox.lane(lambda batch, lost: got.extend(batch))
    lane.offer(1)
    assert inbox.remove(lane) == [1]
    lane.offer(2)
    await turns()
    assert got == []


async def test_a_closed_inbox_gives_its_descriptor_back_and_takes_no_more():
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(20):
        inbox = Inbox()
        lane = inbox.lane(lambda batch, lost: None)
        inbox.close()
        inbox.close()
        lane.offer(1)
    # Sessions of other tests may give theirs back meanwhile, or take one for a moment.
    assert len(os.listdir("/proc/self/fd")) < before + 10


@settings(max_examples=40)
@given(st.lists(st.one_of(st.integers(0, 20), st.none()), max_size=100), st.integers(1, 8))
def test_a_lane_accounts_for_every_entry(steps, depth):
    delivered, losses = [], []

    def handle(batch, lost):
        assert len(batch) <= depth
        delivered.extend(batch)
        losses.append(lost)

    lane = SampleLane(lambda _: None, handle, depth=depth)
    offered = 0
    for step in steps:
        if step is None:
            lane.deliver()
        for _ in range(step or 0):
            lane.offer(offered)
            offered += 1
    lane.deliver()
    assert lane.counters.received == offered == len(delivered) + lane.counters.dropped
    assert sum(losses) == lane.counters.dropped
    assert delivered == sorted(delivered)
    assert not offered or delivered[-1] == offered - 1
