"""How much a sample or a query carries: looked at before anything of it is kept."""

from __future__ import annotations

import zenoh

MAX_BYTES = 4096
"""The most that payload and attachment may have together, unless said otherwise."""


def carried_bytes(carrier: zenoh.Sample | zenoh.Query) -> int:
    """Bytes of payload and attachment: all of a sample that Zenoh does not bound itself.

    Its key matches ours, and the schema of its encoding has 255 bytes at most. A query has
    parameters besides, which only a copy would measure.
    """
    payload, attachment = carrier.payload, carrier.attachment
    size = 0 if payload is None else len(payload)
    return size if attachment is None else size + len(attachment)
