"""The messages to one page, and the rate at which it may send."""

from __future__ import annotations

import asyncio
import json
from typing import Any

import pytest

from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web.page_session import BURST, FRAMES_PER_S, QUEUED, PageSession, part
from yahboomd.web.phone_sessions import PhoneSession


class Socket:
    """A socket that takes frames as fast as a test lets it."""

    def __init__(self) -> None:
        self.taken: list[list[dict[str, Any]]] = []
        self.room = asyncio.Event()
        self.room.set()

    async def send_text(self, text: str) -> None:
        await self.room.wait()
        self.taken.append(json.loads(text))


def session(socket: Socket) -> PageSession:
    return PageSession(1, None, socket, LoopClock(), 0)  # type: ignore[arg-type]


@on_virtual_time
async def test_a_slow_page_gets_the_newest_of_each_kind_and_learns_what_it_lost() -> None:
    socket = Socket()
    page = session(socket)
    sending = asyncio.create_task(page.send())
    socket.room.clear()
    page.show({"beat": part("beat", beat=0)})
    await asyncio.sleep(0.1)
    for beat in range(1, 40):
        page.show({"beat": part("beat", beat=beat), "pose": part("pose", sample=beat)})
        page.queue(part("event", number=beat))
    page.show({"beat": part("beat", beat=40)})
    for number in range(QUEUED):
        page.queue(part("event", number=100 + number))
    socket.room.set()
    await asyncio.sleep(0.1)
    first, second = socket.taken
    assert first == [{"type": "beat", "beat": 0}]
    assert second[0] == {"type": "lost", "count": 39}
    assert [each["number"] for each in second if each["type"] == "event"] == [
        100 + number for number in range(QUEUED)
    ]
    assert [each for each in second if each["type"] in {"beat", "pose"}] == [
        {"type": "beat", "beat": 40},
        {"type": "pose", "sample": 39},
    ]
    sending.cancel()
    await asyncio.gather(sending, return_exceptions=True)


@on_virtual_time
async def test_a_page_that_takes_nothing_for_five_seconds_is_given_up() -> None:
    socket = Socket()
    page = session(socket)
    socket.room.clear()
    page.show({"beat": part("beat", beat=0)})
    began_s = asyncio.get_running_loop().time()
    with pytest.raises(TimeoutError):
        await page.send()
    assert asyncio.get_running_loop().time() - began_s == pytest.approx(5.0, abs=0.01)


@on_virtual_time
async def test_a_page_may_send_a_burst_and_then_so_many_a_second() -> None:
    page = session(Socket())
    assert all(page.may_send() for _ in range(BURST))
    assert not page.may_send()
    await asyncio.sleep(1.0)
    assert sum(page.may_send() for _ in range(BURST)) == pytest.approx(FRAMES_PER_S, abs=2)


@on_virtual_time
async def test_a_page_has_the_role_and_the_name_of_its_phone() -> None:
    assert (session(Socket()).role, session(Socket()).name) == ("driver", "Page 1")
    phone = PhoneSession(
        id="3f9a2c", role="viewer", name="Bert", key="", made_s=0, used_ns=0, touched_ns=0
    )
    page = PageSession(2, phone, Socket(), LoopClock(), 0)  # type: ignore[arg-type]
    assert (page.role, page.name) == ("viewer", "Bert")
    phone.name = "Bertha"
    assert page.name == "Bertha"
