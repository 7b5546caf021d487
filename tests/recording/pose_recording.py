"""A recording of poses, for tests of what reads recordings."""

from __future__ import annotations

import json
from pathlib import Path

from yahboomd.core.bus import keys
from yahboomd.tools.record.mcap_files import Channel, McapFiles

POSE = Channel(keys.POSE, "json", "PoseSample", "jsonschema", '{"type": "object"}')
BEGIN_NS = 1_700_000_000_000_000_000


def record(folder: Path, count: int, *, split: int = 0, ended: bool = True) -> None:
    files = McapFiles(folder, "native", split_bytes=split)
    for number in range(count):
        stamp_ns = BEGIN_NS + number * 20_000_000
        pose = {
            "stamp_ns": stamp_ns,
            "seq": number,
            "frame_id": "odom",
            "child_frame_id": "base_link",
            "x": number * 0.01,
            "y": (number * 7919 % 997) / 31.0,
            "theta": (number * 104729 % 991) / 17.0,
            "covariance": [1e-4 * (number + 1), 0, 0, 0, 1e-4, 0, 0, 0, 1e-4],
        }
        files.write(
            POSE,
            json.dumps(pose).encode(),
            logged_ns=stamp_ns,
            published_ns=stamp_ns,
            sequence=number,
        )
    if ended:
        files.end()
