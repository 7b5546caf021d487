"""Of a test with many cases, each run takes a share, so that a change is not waited for too long.

``@pytest.mark.share(3)`` takes a third of its cases, the same ones every time, and more if that
leaves out a value of a parameter other than ``seed``. ``make grids`` takes them all.
"""

from __future__ import annotations

import os
import zlib
from collections import defaultdict

import pytest


def all_cases() -> bool:
    """Whether every case is to be tried, however long that takes."""
    return bool(os.environ.get("YAHBOOMD_GRIDS"))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the cases beyond each share, unless a test was asked for by name."""
    if all_cases() or config.option.keyword or any("::" in each for each in config.args):
        return
    tests: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("share"):
            tests[item.nodeid.partition("[")[0]].append(item)
    taken = {item for cases in tests.values() for item in share(cases)}
    left = {item for cases in tests.values() for item in cases if item not in taken}
    if left:
        items[:] = [item for item in items if item not in left]
        config.hook.pytest_deselected(items=left)


def share(cases: list[pytest.Item]) -> list[pytest.Item]:
    """The cases of one test that are tried."""
    marker = cases[0].get_closest_marker("share")
    assert marker is not None
    least = -(-len(cases) // marker.args[0])
    missing = {value for case in cases for value in _values(case)}
    left = sorted(cases, key=lambda case: zlib.crc32(case.nodeid.encode()))
    taken: list[pytest.Item] = []
    while missing or len(taken) < least:
        best = max(left, key=lambda case: len(missing & _values(case)))
        left.remove(best)
        taken.append(best)
        missing -= _values(best)
    return taken


def _values(case: pytest.Item) -> set[tuple[str, str]]:
    assert isinstance(case, pytest.Function)
    given = case.callspec.params.items()
    return {(name, str(value)) for name, value in given if name != "seed"}
