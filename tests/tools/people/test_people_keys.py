from __future__ import annotations

import msgspec
import pytest

from yahboomd.client.services import own_source
from yahboomd.core.bus.alarms import READ_BYTES
from yahboomd.tools.people.people_keys import claims_a_name, own_stop, person_of


def test_a_persons_source_has_the_name_in_it() -> None:
    assert person_of(own_source("anna-2")) == "anna-2"


@pytest.mark.parametrize(
    "source", ["cmd_vel", "cmd_vel/teleop", "cmd_vel/web", "cmd_vel/moves", "cmd_vel/a/b", "odom"]
)
def test_a_source_of_a_place_is_no_persons(source: str) -> None:
    assert person_of(source) == ""


def test_no_payload_that_is_read_has_room_for_the_words_of_a_proven_stop() -> None:
    claim = {"by": own_stop("a")}
    assert len(msgspec.json.encode(claim)) > READ_BYTES
    assert len(msgspec.msgpack.encode(claim)) > READ_BYTES


@pytest.mark.parametrize(
    ("by", "claims"),
    [
        (own_stop("anna"), False),
        ("a sample on yahboomd/estop, from tcp/10.0.0.1:7447", False),
        ("the local socket (user 1000, pid 7)", False),
        ("anna", True),
        ("anna, by a key that is this person's alone", True),
    ],
)
def test_a_name_that_only_the_request_claims_is_told_from_one_that_a_key_proves(
    by: str, claims: bool
) -> None:
    assert claims_a_name(f"Emergency stop, engaged by {by} 3 s ago.") is claims


def test_another_reason_claims_no_name() -> None:
    assert not claims_a_name("cmd_vel drives.")
