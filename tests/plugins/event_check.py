"""Holds events against the registry of their kinds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from yahboomd.core.messages.native import EventSample
from yahboomd.tools.schemas.event_kinds import KINDS


def assert_registered(event: Mapping[str, Any]) -> None:
    """The kind is registered; severity, wheel and data agree with the registry.

    Args:
        event: As published, decoded.
    """
    info = KINDS[event["kind"]]
    assert event["severity"] in info.severities, event
    assert info.wheel or event.get("wheel") is None, event
    data = event.get("data")
    if info.data is None:
        assert data is None, event
    else:
        assert info.message is not EventSample
        msgspec.convert(event, info.message)
        assert data is not None
        assert set(data) == set(info.data.__struct_fields__), event
