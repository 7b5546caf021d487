"""Where things live."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = [
    path.relative_to(ROOT / "yahboomd")
    for path in sorted((ROOT / "yahboomd").rglob("*.py"))
    if path.stem not in {"__init__", "__main__"}
]
ROOMS = {path.parts[0] for path in SOURCES if len(path.parts) > 1}


@pytest.mark.parametrize("source", SOURCES, ids=str)
def test_every_source_file_has_tests_of_its_own_name(source: Path) -> None:
    tests = ROOT / "tests" / source.parent / f"test_{source.name}"
    assert tests.is_file()
    assert re.search(r"^(async )?def test_", tests.read_text(), re.MULTILINE)


def test_every_test_of_a_room_belongs_to_a_source_file() -> None:
    strays = [
        path
        for room in ROOMS
        for path in (ROOT / "tests" / room).glob("test_*.py")
        if Path(room, path.name.removeprefix("test_")) not in SOURCES
    ]
    assert strays == []


def test_every_room_says_what_it_is_for() -> None:
    for room in sorted(ROOMS):
        text = (ROOT / "yahboomd" / room / "__init__.py").read_text()
        assert text.startswith('"""'), room
