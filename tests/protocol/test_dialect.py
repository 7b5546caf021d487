"""What must hold of every row of the registry."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.protocol.dialect import (
    Battery,
    CommandLost,
    Deltas,
    Reply,
    Setting,
    Speeds,
    Totals,
    Unrecognised,
    VersionLine,
)
from yahboomd.protocol.framing import Framer
from yahboomd.protocol.registry import DIALECTS
from yahboomd.protocol.settings import PROFILES, BoardSettings

MEANINGS = (
    Battery,
    CommandLost,
    Deltas,
    Reply,
    Setting,
    Speeds,
    Totals,
    Unrecognised,
    VersionLine,
)
dialects = st.sampled_from(list(DIALECTS.values()))


def outgoing(dialect):
    """Every frame that a dialect offers as data."""
    single = (
        dialect.brake,
        dialect.cut,
        dialect.release,
        dialect.probe,
        dialect.poll,
        dialect.battery,
        dialect.read_settings,
        dialect.factory_reset and dialect.factory_reset.frame,
    )
    return [frame for frame in (*single, *dialect.leave, *dialect.arm, *dialect.disarm) if frame]


@pytest.mark.parametrize("name", DIALECTS)
def test_every_frame_is_one_frame_that_the_board_can_take(name):
    dialect = DIALECTS[name]
    for frame in outgoing(dialect):
        assert re.fullmatch(rb"\$[a-zA-Z_]+(:[-0-9.,]+)?#", frame)
        assert len(frame) <= dialect.max_frame_bytes


@given(dialects, st.tuples(*[st.integers()] * 4))
def test_every_speed_frame_carries_four_numbers_in_range(dialect, units):
    frame = dialect.speeds(units)
    assert len(frame) <= dialect.max_frame_bytes
    numbers = [int(number) for number in frame.split(b":")[1].rstrip(b"#").split(b",")]
    assert len(numbers) == 4
    assert max(map(abs, numbers)) <= dialect.max_command


@pytest.mark.parametrize("name", DIALECTS)
def test_the_brake_is_speed_zero(name):
    dialect = DIALECTS[name]
    assert dialect.brake == dialect.speeds((0, 0, 0, 0))


@pytest.mark.parametrize("name", DIALECTS)
def test_leaving_brakes_first_and_then_cuts_where_it_can(name):
    dialect = DIALECTS[name]
    stops = [dialect.brake] if dialect.cut is None else [dialect.brake, dialect.cut]
    assert list(dialect.leave) == [*stops, *dialect.disarm]


@given(dialects, st.binary(max_size=200))
def test_no_bytes_make_a_decoder_raise(dialect, data):
    for item in Framer().feed(data + b"\n"):
        assert isinstance(dialect.decode(item), MEANINGS)
        assert dialect.recognises(item) in {True, False}


@given(dialects, st.sampled_from(["MAll", "MTEP", "MSPD", "Battery", "data"]), st.text(max_size=40))
def test_no_arguments_make_a_decoder_raise(dialect, name, args):
    for item in Framer().feed(f"${name}:{args}#".encode()):
        assert isinstance(dialect.decode(item), MEANINGS)


@pytest.mark.parametrize("name", DIALECTS)
def test_equal_settings_need_no_write(name):
    want = PROFILES["520"].settings
    assert DIALECTS[name].write_settings(want, want) == ()
    assert DIALECTS[name].write_settings(want, BoardSettings()) == ()


@pytest.mark.parametrize("name", DIALECTS)
def test_a_dialect_for_a_profile_keeps_its_name(name):
    assert DIALECTS[name].for_profile(PROFILES["310"]).name == name
