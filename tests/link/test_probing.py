"""A board's description of itself, and the effect of opening its port."""

from __future__ import annotations

import pytest
from board_bench import LinkBench
from hypothesis import example, given, settings
from hypothesis import strategies as st

from yahboomd.core.protocol import registry
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.simulation.motors import FAULTS
from yahboomd.simulation.virtual_time import on_virtual_time
from yahboomd.tools.port.probing import DRIFT_TICKS, compare, examine, reopen

DIALECTS = ["streamed", "polled"]
WANT = PROFILES["520"].settings
counts = st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 4)


@on_virtual_time
async def test_everything_that_a_streamed_board_knows_is_reported() -> None:
    board = LinkBench(initial_ticks=(10, 20, 30, 40), firmware="1.6.5")
    found = await examine(board.open, board.clock, WANT)
    assert found.dialect is not None
    assert found.dialect.name == "streamed"
    assert found.settings is not None
    assert found.settings["version"] == "1.6.5"
    assert found.volts is not None
    assert found.ticks == (10, 20, 30, 40)
    assert found.standing is True
    assert board.ports[0].closed


@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_examining_writes_no_setting_and_moves_nothing(dialect: str) -> None:
    board = LinkBench(dialect=dialect)
    await examine(board.open, board.clock, WANT)
    rosmaster = registry.DIALECTS["rosmaster"]
    of_others = {rosmaster.resync, rosmaster.surest_stop}
    assert of_others <= set(board.frames)
    board.ports[-1].written[:] = [
        (at_ns, data) for at_ns, data in board.ports[-1].written if data not in of_others
    ]
    commands = {frame.split(b":")[0].strip(b"$#") for frame in board.frames}
    assert commands <= {b"pwm", b"speed", b"spd", b"read_flash", b"read", b"upload", b"read_vol"}
    speeds = [frame for frame in board.frames if frame.startswith((b"$spd", b"$pwm", b"$speed"))]
    assert all(frame.endswith(b":0,0,0,0#") for frame in speeds)


@on_virtual_time
async def test_a_port_without_a_board_is_a_finding_not_an_error() -> None:
    board = LinkBench()
    port = await board.open()
    board.robot.hang(board.now_ns)
    port.close()
    found = await examine(board.open, board.clock, WANT)
    assert found.dialect is None


@on_virtual_time
async def test_a_wheel_that_turns_by_itself_is_seen() -> None:
    board = LinkBench()
    board.on_open = lambda _times: board.robot.set_faults(
        "left", FAULTS["turning"], now_ns=board.now_ns
    )
    found = await examine(board.open, board.clock, WANT)
    assert found.standing is False


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_counters_that_survive_a_reopening_are_found_to(dialect: str) -> None:
    board = LinkBench(dialect=dialect, initial_ticks=(5000, 0, -5000, 0))
    found = await examine(board.open, board.clock, WANT)
    again = await reopen(board.open, board.clock, found)
    assert again.survival == "kept"
    assert again.after == (5000, 0, -5000, 0)


@pytest.mark.cases(1)
@pytest.mark.parametrize("dialect", DIALECTS)
@on_virtual_time
async def test_a_board_that_opening_resets_is_found_out(dialect: str) -> None:
    board = LinkBench(dialect=dialect, initial_ticks=(5000, 0, -5000, 0))

    def open_again(times: int) -> None:
        if times:
            board.robot.brown_out(board.now_ns, 0.0)

    board.on_open = open_again
    found = await examine(board.open, board.clock, WANT)
    again = await reopen(board.open, board.clock, found)
    assert again.survival == "reset"
    assert again.after == (0, 0, 0, 0)


@on_virtual_time
async def test_counters_at_zero_tell_nothing_unless_the_board_announces_its_start() -> None:
    board = LinkBench()
    found = await examine(board.open, board.clock, WANT)
    again = await reopen(board.open, board.clock, found)
    assert (again.survival, again.near_zero) == ("unknown", True)
    assert compare((0,) * 4, (0,) * 4, banner=True).survival == "reset"


@settings(max_examples=30)
@example((2**31 - 1, 0, 0, 0), (7, 0, 0, 0))
@given(counts, st.tuples(*[st.integers(-DRIFT_TICKS, DRIFT_TICKS)] * 4))
def test_counters_that_moved_a_little_are_never_taken_for_a_reset(
    before: tuple[int, ...], drift: tuple[int, ...]
) -> None:
    wrapped = [(a + b + 2**31) % 2**32 - 2**31 for a, b in zip(before, drift, strict=True)]
    after = (wrapped[0], wrapped[1], wrapped[2], wrapped[3])
    found = compare((before[0], before[1], before[2], before[3]), after, banner=False)
    assert found.survival != "reset"
    assert found.survival == ("unknown" if found.near_zero else "kept")


@settings(max_examples=30)
@given(counts.filter(lambda ticks: any(abs(each) > DRIFT_TICKS for each in ticks)), st.booleans())
def test_a_fall_to_zero_is_a_reset(ticks: tuple[int, int, int, int], banner: bool) -> None:
    assert compare(ticks, (0, 0, 0, 0), banner=banner).survival == "reset"


def test_counters_that_did_not_come_tell_nothing() -> None:
    assert compare(None, (0, 0, 0, 0), banner=False).survival == "unknown"
    assert compare((9000, 0, 0, 0), None, banner=False).survival == "unknown"


def test_counters_that_are_kept_outweigh_a_banner_made_of_noise() -> None:
    assert compare((9000, 0, 0, 0), (9000, 0, 0, 0), banner=True).survival == "kept"
