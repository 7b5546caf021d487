"""Laws that every row of the registry obeys."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.core.protocol.dialect import (
    Battery,
    CommandLost,
    Deltas,
    Inertial,
    Reply,
    Setting,
    Speeds,
    Totals,
    Unrecognised,
    Unused,
    VersionLine,
)
from yahboomd.core.protocol.profiles import PROFILES
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import writes

MEANINGS = (
    Battery,
    CommandLost,
    Deltas,
    Reply,
    Setting,
    Speeds,
    Totals,
    Unrecognised,
    Unused,
    VersionLine,
    Inertial,
)
LONGEST = 53
"""51 characters between ``$`` and ``#``."""

TEXT = ["streamed", "polled"]
"""Those of ``$name:args#``, with a number for each of four motors."""

dialects = st.sampled_from(list(DIALECTS.values()))


def outgoing(dialect):
    """Every frame that a dialect offers as data."""
    single = (
        dialect.brake,
        dialect.cut,
        dialect.probe,
        dialect.poll,
        dialect.battery,
    )
    return [
        frame for frame in (*single, *dialect.read_settings, *dialect.arm, *dialect.disarm) if frame
    ]


@pytest.mark.parametrize("name", TEXT)
def test_every_frame_is_one_frame_that_the_board_can_take(name):
    dialect = DIALECTS[name]
    for frame in outgoing(dialect):
        assert re.fullmatch(rb"\$[a-zA-Z_]+(:[-0-9.,]+)?#", frame)
        assert len(frame) <= LONGEST


@given(st.sampled_from([DIALECTS[name] for name in TEXT]), st.tuples(*[st.integers()] * 4))
def test_every_speed_frame_carries_four_numbers_in_range(dialect, units):
    frame = dialect.speeds(units)
    assert len(frame) <= LONGEST
    numbers = [int(number) for number in frame.split(b":")[1].rstrip(b"#").split(b",")]
    assert len(numbers) == 4
    assert max(map(abs, numbers)) <= 1000


@given(st.sampled_from([DIALECTS[name] for name in TEXT]), st.tuples(*[st.integers()] * 4))
def test_outputs_without_regulation_are_in_range_where_there_are_any(dialect, outputs):
    stored = 1600
    frame = dialect.outputs(outputs, {"deadzone": stored})
    assert bool(frame) == bool(dialect.most_output)
    if frame:
        numbers = [int(number) for number in frame.split(b":")[1].rstrip(b"#").split(b",")]
        most = dialect.most_output
        above = [max(0, abs(each) - stored) * (1 if each > 0 else -1) for each in outputs]
        assert numbers == [max(-most, min(most, each)) for each in above]


@pytest.mark.parametrize("name", DIALECTS)
def test_the_brake_is_speed_zero(name):
    dialect = DIALECTS[name]
    assert dialect.brake == dialect.speeds((0,) * (4 if name in TEXT else 3))


@given(dialects, st.binary(max_size=200))
def test_no_bytes_make_a_decoder_raise(dialect, data):
    for item in dialect.framer().feed(data + b"\n"):
        assert isinstance(dialect.decode(item), MEANINGS)
        assert dialect.recognises(item) in {True, False}


@given(
    st.sampled_from([DIALECTS[name] for name in TEXT]),
    st.sampled_from(["MAll", "MTEP", "MSPD", "Battery", "data"]),
    st.text(max_size=40),
)
def test_no_arguments_make_a_decoder_raise(dialect, name, args):
    for item in dialect.framer().feed(f"${name}:{args}#".encode()):
        assert isinstance(dialect.decode(item), MEANINGS)


@pytest.mark.parametrize("name", DIALECTS)
def test_equal_settings_need_no_write(name):
    want = PROFILES["520"].settings
    assert writes(DIALECTS[name].settings, want, want) == ()
    assert writes(DIALECTS[name].settings, want, {}) == ()


@pytest.mark.parametrize("name", DIALECTS)
def test_a_dialect_for_a_profile_keeps_its_name(name):
    assert DIALECTS[name].for_profile(PROFILES["310"]).name == name
