from __future__ import annotations

from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, TypeAdapter, ValidationError

from yahboomd.config.values import (
    Choice,
    Endpoint,
    Frame,
    FramePrefix,
    Key,
    Positive,
    Section,
    SourceKey,
    Topic,
    dotted,
    expected,
    one_of,
    toml_string,
    unwrap,
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


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/127.0.0.1:7448",
        "tcp/[::1]:7447",
        "tcp/[fe80::1%eth0]:7447",
        "udp/robot.local:0",
        "tls/10.0.0.1:7447#root_ca_certificate=/etc/ca.pem",
        "tcp/10.0.0.1:7447?rel=1#iface=eth0",
        "quic/localhost:7447",
        "unixsock-stream//run/yahboomd/zenoh.sock",
    ],
)
def test_endpoints_that_zenoh_takes_are_taken(endpoint):
    assert takes(Endpoint, endpoint)


@pytest.mark.parametrize(
    "endpoint",
    [
        "",
        "127.0.0.1:7448",
        "tcp:127.0.0.1:7448",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:70000",
        "tcp/:7447",
        "tcp/::1:7447",
        "tcp/a b:7447",
        "http/localhost:80",
        "ws/localhost:80",
        "serial//dev/ttyUSB0",
        "unixsock-stream/",
        "tcp/127.0.0.1:7448\n",
    ],
)
def test_endpoints_that_zenoh_cannot_use_are_refused(endpoint):
    assert not takes(Endpoint, endpoint)


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


def test_a_choice_of_numbers_takes_no_switch_and_no_fraction():
    sign = Annotated[int, Choice((1, -1))]
    assert takes(sign, -1)
    assert not takes(sign, True)
    assert not takes(sign, 1.0)
    assert not takes(sign, 2)


def test_a_choice_knows_why_a_name_is_refused():
    choice = Choice(("a", "b"), (("c", "c is no more"),))
    assert choice.reason("c1") == "c is no more"
    assert choice.reason("d") == ""
    assert choice.reason(1 << 30_000) == ""  # Python refuses to write so long a number


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (bool, "true or false"),
        (int, "a whole number"),
        (float | None, "a number"),
        (str, "text"),
        (Positive, "a number greater than 0"),
        (Annotated[int, Field(ge=1, le=4)], "a whole number from 1 to 4"),
        (Annotated[float, Field(gt=0, le=5.5)], "a number greater than 0 and at most 5.5"),
        (Annotated[float, Field(lt=1_000_000.0)], "a number less than 1000000"),
        (Literal["a", "b", "c"], '"a", "b" or "c"'),
        (Annotated[int, Choice((1, -1))], "1 or -1"),
        (tuple[Positive, ...], "a list, each entry a number greater than 0"),
        (dict[str, Positive], "a table of names, each a number greater than 0"),
        (bytes, "a value"),
    ],
)
def test_the_words_for_a_type_say_its_bounds(kind, words):
    assert expected(kind) == words


def test_the_words_for_a_table_name_its_keys():
    class Axis(Section):
        velocity: float = 1.0
        jerk: float = 1.0

    assert expected(Axis) == "a table { velocity, jerk }"


def test_constraints_are_found_inside_optional_and_annotated_types():
    kind, marks = unwrap(Annotated[Positive | None, "outer"])
    assert kind is float
    assert marks[0] == "outer"
    assert len(marks) == 2


def test_one_name_needs_no_or():
    assert one_of(["a"]) == '"a"'


def test_a_place_is_written_as_a_person_writes_it():
    place = ("command", "sources", "cmd_vel/teleop", "list", 0, "x")
    assert dotted(place) == 'command.sources."cmd_vel/teleop".list[0].x'


@given(st.text())
def test_any_text_reads_back_from_its_toml_string(text):
    import tomllib

    # Surrogates alone cannot be in a file at all.
    text = text.encode("utf-8", "replace").decode()
    assert tomllib.loads(f"text = {toml_string(text)}")["text"] == text
