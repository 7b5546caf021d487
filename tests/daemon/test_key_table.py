"""The table of keys holds every key, and agrees with the declared ones."""

from __future__ import annotations

from typing import Any

import pytest

from yahboomd.core.bus import keys
from yahboomd.core.daemon.key_table import INPUTS, OFFERS, OUTPUTS, ROS_TOPICS
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages.native import MESSAGES, ServiceReply
from yahboomd.core.messages.rcl_interfaces import ParameterServer
from yahboomd.core.messages.ros2 import TYPE_HASHES
from yahboomd.tools.schemas import cdr_samples
from yahboomd.tools.schemas.event_kinds import EVENTS


def test_every_key_is_in_the_table():
    named = {
        value for name, value in vars(keys).items() if name.isupper() and isinstance(value, str)
    }
    assert named == {*INPUTS, *OUTPUTS, *OFFERS, *ROS_TOPICS, keys.ALIVE}


def test_a_newest_sample_can_be_asked_for_on_every_key_but_that_of_events():
    assert {*keys.SAMPLES, keys.EVENTS} == OUTPUTS.keys()


def test_every_message_is_carried_by_a_key():
    carried = {
        *(output.message for output in OUTPUTS.values()),
        *(message for entry in INPUTS.values() for message in entry.messages),
        *(offer.request for offer in OFFERS.values() if offer.request),
        ServiceReply,
    }
    assert carried == set(MESSAGES.values())
    assert not carried & set(EVENTS.values())


def test_every_type_of_ros_2_is_known_and_has_a_sample():
    types = {
        *(topic.ros_type for topic in ROS_TOPICS.values()),
        *(ros_type for entry in INPUTS.values() for ros_type in entry.ros_types),
        *(offer.ros_type for offer in OFFERS.values() if offer.ros_type),
    }
    parameters = ParameterServer({}, {}, "").services.values()
    assert types | {ros_type for ros_type, _ in parameters} == TYPE_HASHES.keys()
    sampled = {sample.ros_type.partition("_Re")[0] for sample in cdr_samples.CDR.values()}
    assert types == sampled


def test_every_service_of_the_table_is_offered_the_estop_first():
    services: Any = Services(
        None,  # type: ignore[arg-type]
        encoding="json",
        config=dict,
        board=dict,
        newest=lambda _key: None,
        save_box=None,  # type: ignore[arg-type]
    )
    # The one whose answer waits for the disk is served apart.
    assert [*services.actions, keys.BLACKBOX_SAVE] == list(OFFERS)
    assert next(iter(OFFERS)) == keys.ESTOP


@pytest.mark.parametrize("table", [INPUTS, OUTPUTS, OFFERS, ROS_TOPICS])
def test_every_row_says_in_a_phrase_what_or_when(table):
    for row in table.values():
        phrase = getattr(row, "when", "") or row.does
        assert phrase
        assert not phrase.endswith(".")
