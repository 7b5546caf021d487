"""How often an address may fail."""

from __future__ import annotations

import asyncio

from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time
from yahboomd.web.session_routes import ADDRESSES, RateLimit


@on_virtual_time
async def test_after_a_burst_an_address_waits_and_then_has_one_try_each_time() -> None:
    limit = RateLimit(LoopClock(), burst=3, every_s=6.0)
    for _ in range(3):
        assert limit.wait_s("192.0.2.1") == 0
        limit.failed("192.0.2.1")
    assert limit.wait_s("192.0.2.1") == 6
    await asyncio.sleep(6)
    assert limit.wait_s("192.0.2.1") == 0
    limit.failed("192.0.2.1")
    assert limit.wait_s("192.0.2.1") == 6
    await asyncio.sleep(18)
    for _ in range(3):
        assert limit.wait_s("192.0.2.1") == 0
        limit.failed("192.0.2.1")


@on_virtual_time
async def test_addresses_do_not_disturb_each_other_but_those_of_one_machine_are_one() -> None:
    limit = RateLimit(LoopClock(), burst=1, every_s=6.0)
    limit.failed("192.0.2.1")
    limit.failed("2001:db8::1")
    assert limit.wait_s("192.0.2.2") == 0
    assert limit.wait_s("2001:db8::ffff:1") > 0
    assert limit.wait_s("2001:db8:0:1::1") == 0
    limit.failed("")
    assert limit.wait_s("") > 0


@on_virtual_time
async def test_the_addresses_that_are_remembered_are_bounded() -> None:
    limit = RateLimit(LoopClock(), burst=1, every_s=6.0)
    for number in range(ADDRESSES + 1):
        limit.failed(f"198.51.{number // 256}.{number % 256}")
    assert limit.wait_s("198.51.0.0") == 0
    assert limit.wait_s("198.51.0.1") > 0
