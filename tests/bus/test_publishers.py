import asyncio
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh
from zenoh_fixtures import eventually, free_endpoint, late_subscriber

from yahboomd.core.bus import keys
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions
from yahboomd.core.bus.publishers import BusPublisher

pytestmark = pytest.mark.realtime


async def test_samples_carry_payload_encoding_attachment_and_priority(bus, zenoh_app):
    publisher = bus.publisher(
        keys.POSE, encoding="application/msgpack;pose", priority="data_high", express=True
    )
    samples = zenoh_app("client", bus.options.listen[0]).collect("bot1/yahboomd/pose")
    await eventually(lambda: publisher.has_subscribers)
    assert publisher.put(b"\x81\x00", attachment=b"gid")
    (sample,) = await eventually(lambda: samples)
    assert sample.payload.to_bytes() == b"\x81\x00"
    assert str(sample.encoding) == "application/msgpack;pose"
    assert sample.attachment.to_bytes() == b"gid"
    assert sample.priority == zenoh.Priority.DATA_HIGH
    assert sample.congestion_control == zenoh.CongestionControl.DROP
    assert sample.express
    assert publisher.counters.puts == 1


async def test_whether_anybody_listens_follows_the_subscribers(bus, zenoh_app):
    app = zenoh_app("client", bus.options.listen[0])
    subscriber = app.session.declare_subscriber("bot1/yahboomd/pose")
    await eventually(lambda: bus.neighbours)
    early = bus.publisher(keys.POSE)
    await eventually(lambda: early.has_subscribers)
    late = bus.publisher(keys.POSE)
    assert late.has_subscribers
    assert not bus.publisher(keys.TWIST).has_subscribers
    subscriber.undeclare()
    await eventually(lambda: not early.has_subscribers and not late.has_subscribers)


async def test_a_cached_sample_reaches_who_comes_later(bus, zenoh_app):
    publisher = bus.publisher("tf_static", encoding="application/cdr", cache=1)
    assert publisher.has_subscribers
    for payload in (b"old", b"static frames"):
        assert publisher.put(payload)
    app = zenoh_app("client", bus.options.listen[0])
    with late_subscriber(app.session, "bot1/tf_static") as heard:
        assert (await eventually(lambda: heard))[0].payload.to_bytes() == b"static frames"


async def test_put_after_the_end_is_counted_and_not_raised(bus):
    publisher = bus.publisher(keys.POSE)
    await bus.close()
    assert not publisher.put(b"x")
    assert not publisher.put(b"x")
    assert publisher.counters.errors == 2


class PanickingOutlet:
    """As Zenoh's library: a panic is no Exception."""

    matching = True

    def put(self, _payload, attachment):
        raise BaseException(f"panicked with {attachment}")


def test_put_that_panics_is_counted_and_not_raised():
    publisher = BusPublisher(keys.POSE, encoding="", priority="data", express=False, cache=0)
    publisher._outlets.append(PanickingOutlet())
    assert not publisher.put(b"x")
    assert publisher.counters.errors == 1


PATIENT = """
{transport: {link: {tx: {queue: {congestion_control: {block: {wait_before_close: 3600000000}}}}}}}
"""


async def test_a_frozen_subscriber_holds_up_neither_put_nor_the_others(zenoh_app, tmp_path):
    # Were it waited for, the loop would stand still for an hour.
    config = tmp_path / "zenoh.json5"
    config.write_text(PATIENT)
    options = BusOptions(
        listen=(free_endpoint(),), connect=(), namespace="bot1", config_file=config
    )
    async with Bus(options) as bus:
        publisher = bus.publisher(keys.POSE)
        script = Path(__file__).parents[1] / "plugins" / "zenoh_listener_process.py"
        frozen = await asyncio.to_thread(
            subprocess.Popen,
            [sys.executable, str(script), bus.options.listen[0], "bot1/**"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        try:
            assert await asyncio.to_thread(frozen.stdout.readline) == b"ready\n"
            samples = zenoh_app("client", bus.options.listen[0]).collect("bot1/yahboomd/pose")
            await eventually(lambda: publisher.has_subscribers and len(bus.neighbours) == 2)
            frozen.send_signal(signal.SIGSTOP)
            # Far more than the buffers on the way to the frozen one hold.
            for number in range(300):
                assert publisher.put(b"%6d" % number * 10_000)
                await asyncio.sleep(0)
            assert publisher.counters.puts == 300
            await eventually(
                lambda: publisher.put(b"last") and samples and samples[-1].payload == b"last"
            )
        finally:
            frozen.kill()
            frozen.communicate()
