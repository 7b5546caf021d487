"""The registry of events: complete, and what every place that publishes keeps to."""

from __future__ import annotations

import ast
import functools
from pathlib import Path
from typing import get_args

import msgspec

from yahboomd.core.drive.faults import FaultKind
from yahboomd.core.model import EventKind, Severity
from yahboomd.tools.schemas.event_kinds import EVENTS, KINDS, PausedData

SOURCE = Path(__file__).parents[2] / "yahboomd"


@functools.cache
def calls() -> list[tuple[str, dict[str, ast.expr]]]:
    """Every place that makes an event, and its arguments."""
    found = []
    for path in SOURCE.rglob("*.py"):
        if "Event(" not in (text := path.read_text()):
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Event":
                where = f"{path.relative_to(SOURCE)}:{node.lineno}"
                found.append((where, {str(each.arg): each.value for each in node.keywords}))
    return found


def words(node: ast.expr) -> list[str]:
    """The words that an expression may be: a literal, or one of two."""
    branches = (node.body, node.orelse) if isinstance(node, ast.IfExp) else (node,)
    return [branch.value for branch in branches if isinstance(branch, ast.Constant)]


def kinds(passed: dict[str, ast.expr]) -> list[str]:
    # A wheel's fault is the one that hands its own kind on.
    return words(passed["kind"]) or list(get_args(FaultKind))


def test_every_kind_is_registered():
    assert sorted(KINDS) == list(get_args(EventKind))


def test_every_message_of_events_names_the_kinds_that_it_is_for():
    for name, message in EVENTS.items():
        fields = {field.name: field.type for field in msgspec.structs.fields(message)}
        assert sorted(get_args(fields["kind"])) == sorted(
            kind for kind, info in KINDS.items() if info.message is message
        ), name


def test_every_kind_is_published_somewhere():
    assert {kind for _, passed in calls() for kind in kinds(passed)} == KINDS.keys()


def test_every_place_that_publishes_fits_the_registry():
    for where, passed in calls():
        for kind in kinds(passed):
            info = KINDS[kind]
            severities = words(passed["severity"])
            assert severities, where
            if len(words(passed["kind"])) == 1:
                assert set(severities) == set(info.severities), where
            assert ("wheel" in passed) == info.wheel, where
            data = passed.get("data")
            assert (data is None) == (info.data is None), where
            if info.data is not None:
                assert isinstance(data, ast.Dict), where
                keys = [key.value for key in data.keys if isinstance(key, ast.Constant)]
                assert keys == list(info.data.__struct_fields__), where


def test_every_kind_is_described():
    for kind, info in KINDS.items():
        assert info.when.endswith("."), kind
        assert set(info.severities) <= set(get_args(Severity)), kind
        assert info.severities
    for message in EVENTS.values():
        assert message.__doc__
        schema = msgspec.json.schema(message)["$defs"]
        data = next(part for name, part in schema.items() if name.endswith("Data"))
        assert all("description" in field for field in data["properties"].values())


def test_a_kind_has_the_data_of_its_message():
    assert KINDS["paused"].data is PausedData
    assert KINDS["connected"].data is None
