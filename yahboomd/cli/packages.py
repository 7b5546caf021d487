"""What packages of their own bring: commands such as `yahboomd fleet`, found by entry points.

Finding them takes a tenth of a second. So only a word that yahboomd does not know, its help and its
completions look for them: no `yahboomd stop` waits.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import cast

from yahboomd.core.program import COMMANDS


def commands() -> dict[str, EntryPoint]:
    """The commands of the installed packages, but for names that yahboomd itself has."""
    found = entry_points(group="yahboomd.commands")
    return {each.name: each for each in found if each.name not in COMMANDS}


def lines(found: Mapping[str, EntryPoint]) -> dict[str, str]:
    """Their lines in the help: the summaries of the packages, none of which is imported."""
    return {
        name: "" if each.dist is None else each.dist.metadata["Summary"]
        for name, each in found.items()
    }


def page_part(name: str) -> object:
    """What a package brings for the page of `yahboomd web`.

    Raises:
        ModuleNotFoundError: The package is not installed.
    """
    for found in entry_points(group="yahboomd.page", name=name):
        return cast(object, found.load())
    raise ModuleNotFoundError(name=f"yahboomd-{name}")
