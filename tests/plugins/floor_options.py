"""The floor under a bench's robots: ``make moves STICKS=1.3 FRICTION_SCALES=1,1.1``."""

from __future__ import annotations

import os

NAMES = ("friction_scales", "sticks")


def floor_options() -> dict[str, tuple[float, ...]]:
    """The options of a simulated robot that make was given; its own floor lacks both."""
    given = {name: os.environ.get(name.upper(), "") for name in NAMES}
    return {name: tuple(map(float, text.split(","))) for name, text in given.items() if text}
