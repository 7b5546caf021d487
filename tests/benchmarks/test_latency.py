from __future__ import annotations

import msgspec

from benchmarks.latency import DAEMON, LOOP, SOCKET, ZENOH, busy_until_ns, command, matched
from benchmarks.thin_board import BYTE_NS, Log

MS = 1_000_000


def heard(where, *entries):
    log = Log(heard=[(port, at, data) for port, at, data in entries])
    (where / "heard").write_bytes(msgspec.msgpack.encode(log))


def test_a_command_says_metres_per_second() -> None:
    assert command(305) == b'{"vx":0.305,"wz":0.0}'
    assert command(1005) == b'{"vx":1.005,"wz":0.0}'


def test_each_frame_is_found_for_the_command_that_asked_for_it(tmp_path) -> None:
    ways = (ZENOH, SOCKET, DAEMON, LOOP)
    sent = [(way, 300, n * 10 * MS) for n, way in enumerate(ways, 10)]
    heard(
        tmp_path,
        (DAEMON, 50 * MS, b"$spd:293,0,293,0#"),
        (ZENOH, 101 * MS, b"$spd:300,0,300,0#"),
        (SOCKET, 112 * MS, b"$spd:300,0,300,0#"),
        (DAEMON, 123 * MS, b"$spd:300,0,300,0#"),
        (LOOP, 134 * MS, b"$spd:300,0,300,0#"),
    )
    run = matched(sent, tmp_path, "streamed")
    assert (run.zenoh, run.socket, run.free, run.loop) == ([MS], [2 * MS], [3 * MS], [4 * MS])
    assert run.waited == []
    assert run.lost == 0


def test_a_command_behind_another_frame_counts_as_one_that_waited(tmp_path) -> None:
    sent = [(DAEMON, 300, 100 * MS), (DAEMON, 307, 200 * MS)]
    heard(
        tmp_path,
        # The line is still busy with this one ...
        (DAEMON, 95 * MS, b"$read_vol#"),
        (DAEMON, 110 * MS, b"$spd:300,0,300,0#"),
        # ... and another slips in between here.
        (DAEMON, 200 * MS + 1, b"$spd:300,0,300,0#"),
        (DAEMON, 212 * MS, b"$spd:307,0,307,0#"),
    )
    run = matched(sent, tmp_path, "streamed")
    assert run.free == []
    assert run.waited == [10 * MS, 12 * MS]


def test_a_frame_that_never_comes_is_counted(tmp_path) -> None:
    heard(tmp_path, (DAEMON, 50 * MS, b"$spd:293,0,293,0#"))
    assert matched([(DAEMON, 300, 40 * MS)], tmp_path, "streamed").lost == 1


def test_the_line_is_busy_for_bytes_and_spacing() -> None:
    frame = b"$spd:300,0,300,0#"
    assert busy_until_ns((0, frame), "streamed") == len(frame) * BYTE_NS + 10 * MS
    assert busy_until_ns((0, frame), "polled") == len(frame) * BYTE_NS
