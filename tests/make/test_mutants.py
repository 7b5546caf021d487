"""`make mutants`: the changes, and what becomes of one that tests notice or do not."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

pytest.importorskip("cosmic_ray", reason="`make mutants` installs it")

ROOT = Path(__file__).resolve().parents[2]
_SPEC = importlib.util.spec_from_file_location("mutants_tool", ROOT / "make" / "mutants.py")
assert _SPEC is not None
assert _SPEC.loader is not None
tool = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(tool)


@pytest.mark.parametrize(
    ("line", "changed"),
    [
        ("x = a < b", {"x = a <= b", "x = a > b"}),
        ("x = a - -b", {"x = a + -b", "x = a - b"}),
        ("x = min(a, 2)", {"x = max(a, 2)", "x = min(a, 3)"}),
        ("x = 60_000 and y", {"x = 120000 and y", "x = 60_000 or y"}),
        ("x = not y", {"x =  y"}),
        ("x = f(*y, **z)", set()),
        ("x = '1 < 2'  # 3", set()),
        ("class X(Struct, frozen=True): x = 1", set()),
    ],
)
def test_each_token_that_computes_is_changed_and_no_other(
    tmp_path: Path, line: str, changed: set[str]
) -> None:
    path = tmp_path / "some.py"
    path.write_text(f"y = z\n{line}\n")
    for place in tool.places(path):
        assert place[-1] == 2
        text, before, after = tool.change(*place)
        assert text.startswith("y = z\n")
        assert before == line
        changed.remove(after)
    assert changed == set()


def test_every_room_has_its_files_and_its_tests() -> None:
    for where, tests in tool.ROOMS.values():
        assert (ROOT / where).exists()
        assert all((ROOT / each).exists() for each in tests)


def test_changes_that_cannot_be_noticed_are_still_in_the_source_and_have_a_reason() -> None:
    listed = [
        line.split(" | ")
        for line in tool.EQUIVALENT.read_text().splitlines()
        if not line.startswith("#")
    ]
    for name, before, after, why in listed:
        source = (ROOT / name).read_text()
        assert f"{before.strip()}\n" in source
        assert before != after
        assert why
