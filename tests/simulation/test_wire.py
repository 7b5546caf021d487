from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from yahboomd.simulation.wire import Wire, transfer_ns

runs = st.lists(
    st.tuples(st.integers(0, 3_000_000), st.binary(min_size=1, max_size=40)), max_size=8
)


def test_a_byte_takes_86_8_microseconds() -> None:
    assert transfer_ns(1, 115200) == 86_805
    assert transfer_ns(1152, 115200) == 100_000_000


def test_a_byte_arrives_when_its_last_bit_has() -> None:
    wire = Wire(115200)
    wire.send(b"ab", 1000)
    assert wire.first_ns == 1000 + 86_805
    assert wire.take(1000 + 86_804) == b""
    assert wire.take(1000 + 86_805) == b"a"
    assert wire.idle_ns == 1000 + 173_611
    assert wire.take(wire.idle_ns) == b"b"
    assert wire.empty


def test_bytes_queue_behind_those_on_the_line() -> None:
    wire = Wire(115200)
    wire.send(b"x" * 1152, 0)
    wire.send(b"y", 50_000_000)
    assert wire.idle_ns == 100_000_000 + 86_805


@given(runs, st.lists(st.integers(0, 20_000_000), max_size=20))
def test_everything_arrives_once_in_order_and_at_its_own_time(
    sent: list[tuple[int, bytes]], looks: list[int]
) -> None:
    whole, parts = Wire(115200), Wire(115200)
    now_ns = 0
    for gap_ns, data in sent:
        now_ns += gap_ns
        whole.send(data, now_ns)
        parts.send(data, now_ns)
    at_once = whole.take_each(2**62)
    assert bytes(byte for byte, _ in at_once) == b"".join(data for _, data in sent)
    times = [at_ns for _, at_ns in at_once]
    assert all(b - a >= 86_805 for a, b in itertools.pairwise(times))
    taken = b""
    for look_ns in sorted(looks):
        taken += parts.take(look_ns)
        assert len(taken) == sum(at_ns <= look_ns for at_ns in times)
    assert taken + parts.take(2**62) == b"".join(data for _, data in sent)


def test_a_sender_that_stops_leaves_what_has_arrived() -> None:
    wire = Wire(115200)
    wire.send(b"abcdef", 0)
    wire.cut(3 * 86_806)
    wire.send(b"X", 10_000_000)
    assert wire.take(20_000_000) == b"abcX"


def test_a_cleared_line_is_free_at_once() -> None:
    wire = Wire(115200)
    wire.send(b"x" * 1000, 0)
    wire.clear()
    wire.send(b"y", 0)
    assert wire.take(86_805) == b"y"
