from __future__ import annotations

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from yahboomd.core.config.values import (
    Endpoint,
    Frame,
    FramePrefix,
    Key,
    RelayLine,
    Sign,
    SourceKey,
    Topic,
    dotted,
    inline,
)


def takes(kind, value) -> bool:
    try:
        TypeAdapter(kind).validate_python(value, strict=True)
    except ValidationError:
        return False
    return True


@pytest.mark.parametrize("name", ["", "bot1", "fleet/bot-1", "a.b"])
def test_a_namespace_may_have_inner_slashes(name):
    assert takes(Key, name)


@pytest.mark.parametrize(
    "name", ["/bot1", "bot1/", "a//b", "*", "a/**", "a$*", "a?b", "a#b", "@a", "a b", "a\n", "/"]
)
def test_a_namespace_that_is_no_plain_key_is_refused(name):
    assert not takes(Key, name)
    assert not takes(SourceKey, name)


@pytest.mark.parametrize("name", ["yahboomd", "yahboomd/estop", ""])
def test_a_source_is_never_one_of_our_own_keys(name):
    assert not takes(SourceKey, name)


def test_a_source_may_merely_start_like_our_own_keys():
    assert takes(SourceKey, "yahboomd_joy")


def test_frames_and_topics_start_without_a_slash():
    assert takes(Frame, "bot1/odom")
    assert not takes(Frame, "/odom")
    assert not takes(Frame, "")
    assert takes(FramePrefix, "")
    assert takes(FramePrefix, "bot1/")
    assert takes(Topic, "wheel/odom")
    assert not takes(Topic, "/odom")
    assert not takes(Topic, "odom/")
    assert not takes(Topic, "1odom")


def test_a_sign_is_no_switch_and_no_fraction():
    assert takes(Sign, -1)
    assert not takes(Sign, True)
    assert not takes(Sign, 1.0)
    assert not takes(Sign, 2)


def test_a_relay_has_a_line_and_no_level():
    assert takes(RelayLine, "")
    assert takes(RelayLine, "/dev/gpiochip0:17")
    for level in ("/dev/gpiochip0:17=1", "/dev/gpiochip0:17:high", "/dev/gpiochip0", "17", "high"):
        assert not takes(RelayLine, level)


def test_an_endpoint_is_refused_with_the_reason():
    assert takes(Endpoint, "tcp/[::1]:7447")
    with pytest.raises(ValidationError, match="70000 is not a port"):
        TypeAdapter(Endpoint).validate_python("tcp/[::1]:70000")


def test_a_place_is_written_as_a_person_writes_it():
    place = ("command", "sources", "cmd_vel/teleop", "list", 0, "x")
    assert dotted(place) == 'command.sources."cmd_vel/teleop".list[0].x'


@given(st.text())
def test_any_text_reads_back_from_its_inline(text):
    # Surrogates alone cannot be in a file at all.
    text = text.encode("utf-8", "replace").decode()
    assert tomllib.loads(f"text = {inline(text)}")["text"] == text


def test_values_are_written_as_toml():
    value = {"a b": [True, 1, 1.5, "x"], "c": {}}
    assert inline(value) == '{ "a b" = [true, 1, 1.5, "x"], c = {} }'
