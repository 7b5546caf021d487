from __future__ import annotations

import pytest
import ruamel.yaml
from hypothesis import given
from hypothesis import strategies as some

from yahboomd.tools.ros_files.yaml_text import as_yaml

NUMBERS = some.floats(-1e6, 1e6).map(lambda value: round(value, 6) + 0.0)
VALUES = some.one_of(NUMBERS, some.integers(), some.booleans(), some.text("ab/: #'\"é", max_size=9))
TREES = some.recursive(
    some.one_of(VALUES, some.lists(NUMBERS)),
    lambda inner: some.dictionaries(some.from_regex("[a-z]{1,6}", fullmatch=True), inner,
                                    min_size=1, max_size=4),
    max_leaves=12,
)  # fmt: skip


def loaded(text: str) -> object:
    return ruamel.yaml.YAML(typ="safe", pure=True).load(text)


@given(some.dictionaries(some.sampled_from(["amcl", "joy"]), TREES, min_size=1))
def test_what_is_written_is_read_back(tree) -> None:
    assert loaded(as_yaml(tree)) == tree


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.0, "1.0"), (-0.0, "0.0"), (1e-6, "0.000001"), (True, "true"), (3, "3"), ("no", '"no"')],
)
def test_types_are_plain_to_see(value, text) -> None:
    assert as_yaml({"key": value}) == f"key: {text}\n"
