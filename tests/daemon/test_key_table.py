"""The table of keys holds every key, and agrees with the declared ones."""

from __future__ import annotations

from typing import Any

import pytest

from yahboomd.core.bus import keys
from yahboomd.core.daemon.publisher import PUBLISHED
from yahboomd.core.daemon.requests import Services
from yahboomd.core.messages.native import ServiceReply
from yahboomd.ros2.ros2_topics import ROS_TOPICS
from yahboomd.tools.schemas.event_kinds import EVENTS
from yahboomd.tools.schemas.key_table import INPUTS, OFFERS, OUTPUTS
from yahboomd.tools.schemas.samples import MESSAGES


def test_every_key_is_in_the_table():
    named = {
        value for name, value in vars(keys).items() if name.isupper() and isinstance(value, str)
    }
    assert named == {*INPUTS, *OUTPUTS, *OFFERS, keys.ALIVE}


def test_a_newest_sample_can_be_asked_for_on_every_key_but_that_of_events():
    assert {*keys.SAMPLES, keys.EVENTS} == OUTPUTS.keys()


def test_the_table_has_the_messages_that_the_daemon_publishes():
    assert {key: output.message for key, output in OUTPUTS.items()} == PUBLISHED


def test_every_message_is_carried_by_a_key():
    carried = {
        *(output.message for output in OUTPUTS.values()),
        *(message for entry in INPUTS.values() for message in entry.messages),
        *(offer.request for offer in OFFERS.values() if offer.request),
        ServiceReply,
    }
    assert carried == set(MESSAGES.values())
    assert not carried & set(EVENTS.values())


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
