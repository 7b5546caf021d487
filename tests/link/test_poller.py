"""The poller: asks on schedule, or watches that counts come."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from yahboomd.core.errors import BoardSilent
from yahboomd.core.link.poller import REARM_AFTER_S, SILENT_AFTER_S, Poller
from yahboomd.core.model import EncoderReading
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.virtual_time import LoopClock, VirtualTimeLoop, on_virtual_time


class Pen:
    """A writer that notes the frames to send."""

    def __init__(self) -> None:
        self.polls: list[int] = []
        self.frames: list[bytes] = []
        self.open = False

    def poll(self, frame: bytes, timeout_ns: int) -> bool:
        if self.open:
            return False
        self.polls.append(LoopClock().now_ns())
        return True

    def queue(self, frame: bytes) -> None:
        self.frames.append(frame)


class Scene:
    def __init__(self, dialect: str, period_ns: int = 20_000_000) -> None:
        self.pen = Pen()
        self.readings: list[EncoderReading] = []
        self.armed: list[int] = []
        self.poller = Poller(
            self.pen,  # type: ignore[arg-type]
            LoopClock(),
            DIALECTS[dialect],
            period_ns=period_ns,
            on_reading=self.readings.append,
            on_armed=lambda: self.armed.append(LoopClock().now_ns()),
            port_name="/dev/x",
        )
        self.task = asyncio.create_task(self.poller.run())

    def hear(self) -> None:
        now_ns = LoopClock().now_ns()
        reading = EncoderReading(ticks=(1, 2, 3, 4), received_ns=now_ns, sent_ns=now_ns - 1)
        self.poller.reading(reading)

    async def end(self) -> None:
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)


@on_virtual_time
async def test_polls_keep_an_absolute_schedule() -> None:
    scene = Scene("polled", 5_000_000)
    for _ in range(1000):
        await asyncio.sleep(0.005)
        scene.hear()
    await scene.end()
    first = scene.pen.polls[0]
    drift = [at - first - n * 5_000_000 for n, at in enumerate(scene.pen.polls)]
    assert len(drift) >= 999
    assert max(map(abs, drift)) <= 1_000


@on_virtual_time
async def test_a_poll_that_finds_the_line_busy_is_skipped_and_counted() -> None:
    scene = Scene("polled")
    scene.pen.open = True
    await asyncio.sleep(0.1)
    await scene.end()
    assert scene.poller.counters["polls_skipped"] >= 4


@on_virtual_time
async def test_a_streaming_board_is_not_polled() -> None:
    scene = Scene("streamed")
    for _ in range(100):
        await asyncio.sleep(0.01)
        scene.hear()
    await scene.end()
    assert scene.pen.polls == []
    assert scene.pen.frames == []


@on_virtual_time
async def test_a_stream_that_pauses_is_armed_again_and_the_port_was_not_away() -> None:
    scene = Scene("streamed")
    scene.hear()
    await asyncio.sleep(REARM_AFTER_S + 0.1)
    assert scene.pen.frames == [b"$upload:1,0,0#"]
    scene.hear()
    await scene.end()
    assert [reading.after_gap for reading in scene.readings] == [True, False]
    assert len(scene.armed) == 1


@on_virtual_time
async def test_only_the_first_reading_says_that_the_stream_ran_before() -> None:
    scene = Scene("streamed")
    scene.poller.unbroken = True
    scene.hear()
    scene.hear()
    await scene.end()
    assert [reading.unbroken for reading in scene.readings] == [True, False]


@on_virtual_time
async def test_silence_ends_it() -> None:
    scene = Scene("streamed")
    with pytest.raises(BoardSilent, match="/dev/x: the board sent no counts"):
        await asyncio.wait_for(scene.task, SILENT_AFTER_S + 0.5)


@pytest.mark.parametrize("dialect", ["polled", "streamed"])
@on_virtual_time
async def test_a_time_in_which_this_process_did_not_run_is_no_silence(dialect: str) -> None:
    scene = Scene(dialect)
    scene.hear()
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualTimeLoop)
    loop.freeze(5.0)
    await asyncio.sleep(0.2)
    assert scene.pen.frames == []
    with pytest.raises(BoardSilent):
        await asyncio.wait_for(scene.task, SILENT_AFTER_S + 0.5)


@on_virtual_time
async def test_after_a_reset_the_stream_is_armed_and_the_next_reading_is_marked() -> None:
    scene = Scene("streamed")
    scene.hear()
    scene.poller.board_reset()
    assert scene.pen.frames == [b"$upload:1,0,0#"]
    scene.hear()
    scene.hear()
    await scene.end()
    assert [reading.after_reset for reading in scene.readings] == [False, True, False]


@on_virtual_time
async def test_a_reading_passes_through_at_once_and_is_counted() -> None:
    scene = Scene("polled")
    scene.hear()
    assert scene.readings[0].ticks == (1, 2, 3, 4)
    await scene.end()
    counters: dict[str, Any] = scene.poller.counters
    assert counters["readings"] == 1
