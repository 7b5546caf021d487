"""Laws that every simulated board obeys."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from yahboomd.simulation.board import NEVER, BoardModel

MakeBench = Callable[..., Any]

both = pytest.mark.parametrize("dialect", ["streamed", "polled"])

FRAGMENTS = st.sampled_from(
    (
        *(b"$", b"#", b",", b":", b"spd", b"pwm:", b"$speed:1,2,3,4#", b"$mline:0#"),
        *(b"$MPID:1,1,1#", b"$upload:1,1,1#", b"$read#", b"$read_flash#", b"$mtype:1#"),
        *(b"$mtype:4#", b"$spd:1,1,1,1,1,1,1,1,1,1,1,1,1,1#", b"\n" * 64),
    )
)


@both
@settings(
    max_examples=50,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(noise=st.lists(st.one_of(FRAGMENTS, st.binary(max_size=20)), max_size=20))
def test_no_bytes_disturb_a_board_for_good(
    bench: MakeBench, dialect: str, noise: list[bytes]
) -> None:
    desk = bench(dialect=dialect)
    for part in noise:
        desk.send(part, 0.01)
    desk.run(1.5)
    desk.robot.brown_out(desk.now_ns)
    desk.run(0.2)
    assert desk.send(b"$read#") != b""


@both
def test_every_reset_starts_the_counters_from_zero(bench: MakeBench, dialect: str) -> None:
    desk = bench(dialect=dialect, initial_ticks=(5, 6, 7, 8))
    assert desk.robot.board.totals == (5, 6, 7, 8)
    desk.robot.reset(desk.now_ns)
    desk.run(0.5)
    assert desk.robot.board.totals == (0, 0, 0, 0)


@both
def test_a_starting_board_is_deaf(bench: MakeBench, dialect: str) -> None:
    desk = bench(dialect=dialect)
    desk.robot.brown_out(desk.now_ns, 0.1)
    assert b"data" not in desk.send(b"$read#", 0.1)
    assert b"not found" not in desk.run(0.5)


@both
def test_a_hung_board_does_nothing_until_a_reset(bench: MakeBench, dialect: str) -> None:
    desk = bench(dialect=dialect)
    desk.robot.hang(desk.now_ns)
    assert desk.send(b"$read#", 1.0) == b""
    board: BoardModel = desk.robot.board
    assert (board.next_ns, board.speaks_ns) == (NEVER, NEVER)
    desk.robot.reset(desk.now_ns)
    desk.run(0.5)
    assert desk.send(b"$read#") != b""
