"""Calls that block: one bounded in time, many in order."""

import asyncio
import subprocess
import sys
import threading

import pytest
from zenoh_fixtures import eventually

from yahboomd.core.bus.blocking import Sender, bounded


async def test_result_of_the_call_is_returned():
    assert await bounded(lambda: 7, timeout_s=20, name="test") == 7


async def test_error_of_the_call_is_raised():
    with pytest.raises(ZeroDivisionError):
        await bounded(lambda: 1 / 0, timeout_s=20, name="test")


async def test_a_call_that_never_returns_is_left_behind_in_a_daemon():
    release, late = threading.Event(), []
    with pytest.raises(TimeoutError):
        await bounded(
            lambda: release.wait() and "late", timeout_s=0.01, name="stuck", late=late.append
        )
    (thread,) = [thread for thread in threading.enumerate() if thread.name == "stuck"]
    assert thread.daemon
    release.set()
    await eventually(lambda: late)
    assert late == ["late"]


async def test_result_goes_to_late_when_the_waiting_task_is_cancelled():
    release, late = threading.Event(), []
    task = asyncio.create_task(
        bounded(lambda: release.wait() and 1, timeout_s=20, name="cancelled", late=late.append)
    )
    await asyncio.sleep(0)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    release.set()
    await eventually(lambda: late)


def test_result_goes_to_late_when_the_loop_has_ended():
    release, done, late = threading.Event(), threading.Event(), []

    async def leave():
        with pytest.raises(TimeoutError):
            await bounded(
                lambda: release.wait() and 1,
                timeout_s=0.01,
                name="orphan",
                late=lambda result: (late.append(result), done.set()),
            )

    asyncio.run(leave())
    release.set()
    assert done.wait(20)
    assert late == [1]


async def test_a_cancellation_that_comes_with_the_result_is_kept_and_so_is_the_result():
    loop = asyncio.get_running_loop()
    ready, late = threading.Event(), []
    task = asyncio.create_task(bounded(ready.wait, timeout_s=20, name="race", late=late.append))
    await asyncio.sleep(0)
    (thread,) = [thread for thread in threading.enumerate() if thread.name == "race"]
    ready.set()
    thread.join()
    # The result waits in the loop's queue now; the cancellation comes right behind it.
    loop.call_soon(task.cancel)
    with pytest.raises(asyncio.CancelledError):
        await task
    await eventually(lambda: late)
    assert late == [True]


LEFT_INSIDE_ZENOH = """
import asyncio, time, zenoh
from yahboomd.core.bus.blocking import bounded
config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect", '{endpoints: ["tcp/127.0.0.1:1"], timeout_ms: 300}')
class SlowToTearDown:
    def __del__(self, sleep=time.sleep):
        sleep(1.5)
asyncio.slow = SlowToTearDown()
async def main():
    await bounded(lambda: zenoh.open(config), timeout_s=0.05, name="test")
try:
    asyncio.run(main())
except TimeoutError:
    raise SystemExit(7)
"""


@pytest.mark.nightly
@pytest.mark.realtime
def test_a_process_that_ends_while_a_call_is_inside_zenoh_keeps_its_status():
    ended = subprocess.run([sys.executable, "-c", LEFT_INSIDE_ZENOH], timeout=60, check=False)
    assert ended.returncode == 7


def test_work_is_done_in_order_by_one_thread():
    sender, done = Sender("test-sender"), []
    for number in range(100):
        assert sender.send(lambda number=number: done.append((number, threading.current_thread())))
    assert sender.close(20)
    assert [number for number, _ in done] == list(range(100))
    assert len({thread for _, thread in done}) == 1
    assert done[0][1] is not threading.current_thread()


def test_no_thread_before_the_first_work():
    assert Sender("idle").close(20)
    assert not any(thread.name == "idle" for thread in threading.enumerate())


def test_a_stuck_thread_bounds_the_queue_and_does_not_hold_the_caller():
    release, sender = threading.Event(), Sender("stuck-sender")
    taken = 0
    while sender.send(release.wait) and taken < 10_000:
        taken += 1
    assert taken < 1_000
    assert not sender.close(0.01)
    release.set()
    assert sender.close(20)


def test_work_that_raises_loses_itself_alone():
    class Panic(BaseException):
        """As Zenoh's library raises it."""

    def panic():
        raise Panic

    sender, done = Sender("panicking-sender"), []
    for work in (panic, panic, lambda: done.append(1)):
        assert sender.send(work)
    assert sender.close(20)
    assert done == [1]


def test_without_room_for_a_thread_work_is_refused_and_the_next_one_is_done(monkeypatch):
    def no_room(_thread):
        raise RuntimeError("can't start new thread")

    sender, done = Sender("roomless-sender"), []
    with monkeypatch.context() as limited:
        limited.setattr(threading.Thread, "start", no_room)
        assert not sender.send(lambda: done.append(1))
        assert sender.close(20)
    assert sender.send(lambda: done.append(2))
    assert sender.close(20)
    assert done == [2]


def test_it_ends_well_while_its_first_call_comes_from_another_thread():
    for _ in range(10):
        sender = Sender("first-sender")
        first = threading.Thread(target=sender.send, args=(lambda: None,))
        first.start()
        while not sender._thread:
            pass
        assert sender.close(20)
        first.join()
