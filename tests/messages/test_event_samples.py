"""The golden samples of events are events of their kind."""

from __future__ import annotations

import msgspec
import pytest
from event_check import assert_registered

from make.schema_files.event_samples import SAMPLES
from yahboomd.core.messages.codecs import encode
from yahboomd.core.messages.native import EventSample
from yahboomd.tools.schemas.event_kinds import EVENTS


def test_every_event_with_data_has_a_sample():
    assert SAMPLES.keys() == EVENTS.keys()
    assert all(isinstance(SAMPLES[name], EVENTS[name]) for name in EVENTS)


@pytest.mark.parametrize("name", SAMPLES)
def test_both_encodings_of_a_sample_hold_the_same(name):
    message = SAMPLES[name]
    assert msgspec.json.decode(encode(message, "json"), type=EVENTS[name]) == message
    assert msgspec.msgpack.decode(encode(message, "msgpack"), type=EVENTS[name]) == message


@pytest.mark.parametrize("name", SAMPLES)
def test_a_sample_is_an_event_that_fits_the_registry(name):
    payload = encode(SAMPLES[name], "json")
    assert_registered(msgspec.json.decode(payload))
    assert isinstance(msgspec.json.decode(payload, type=EventSample), EventSample)
