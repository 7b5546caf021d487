"""`make planted-faults`: every fault can be put in."""

from __future__ import annotations

import ast
import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_SPEC = importlib.util.spec_from_file_location("planted_tool", ROOT / "make" / "planted_faults.py")
assert _SPEC is not None
assert _SPEC.loader is not None
tool = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(tool)


@pytest.mark.parametrize("fault", tool.faults().values(), ids=lambda fault: fault["name"])
def test_a_fault_still_applies_and_the_faulty_file_can_be_imported(fault: dict[str, str]) -> None:
    path = ROOT / fault["file"]
    changed = tool.planted(fault, path.read_text())
    assert changed is not None, "its text is not there once: write it for the code of today"
    assert changed != path.read_text()
    assert fault["claim"].endswith(".")
    if path.suffix == ".py":
        ast.parse(changed)


def test_there_are_twenty_faults_in_the_rooms_where_time_counts() -> None:
    found = list(tool.faults().values())
    assert len(found) == tool.FAULTS.read_text().count("[[fault]]") >= 20
    assert len({fault["file"] for fault in found}) >= 18
