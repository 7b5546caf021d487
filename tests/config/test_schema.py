from __future__ import annotations

import json
import tomllib
from typing import Annotated, Literal

import jsonschema
import pytest
from pydantic import Field, TypeAdapter

from yahboomd.core.config.schema import as_json, constraint, entry_table, node_at, places, takes
from yahboomd.core.config.values import Positive, Sign
from yahboomd.tools.schemas.reference import default_toml


def test_the_schema_accepts_the_default_file_and_refuses_a_mistake():
    validator = jsonschema.Draft202012Validator(json.loads(as_json()))
    document = tomllib.loads(default_toml())
    assert list(validator.iter_errors(document)) == []
    document["board"]["profile"] = "521"
    document["serial"]["prot"] = "x"
    document["chassis"]["motors"]["left"][0]["position"] = 5
    document["command"]["sources"]["x"] = {"priority": "high"}
    assert len(list(validator.iter_errors(document))) == 4


def test_every_key_has_a_description():
    definitions = json.loads(as_json())["$defs"]
    for name, model in definitions.items():
        for key, entry in model["properties"].items():
            assert entry.get("description", "").endswith("."), f"{name}.{key}"


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (bool, "true or false"),
        (int, "a whole number"),
        (float | None, "a number"),
        (str, "text"),
        (Positive, "a number greater than 0"),
        (Annotated[int, Field(ge=1, le=4)], "a whole number from 1 to 4"),
        (Annotated[float, Field(gt=0, le=5.5)], "a number greater than 0 and at most 5.5"),
        (Annotated[float, Field(lt=1_000_000.0)], "a number less than 1000000"),
        (Literal["a", "b", "c"], '"a", "b" or "c"'),
        (Sign, "1 or -1"),
        (tuple[Positive, ...], "a list, each entry a number greater than 0"),
        (dict[str, Positive], "a table of names, each a number greater than 0"),
    ],
)
def test_the_words_for_a_type_say_its_bounds(kind, words):
    assert takes(TypeAdapter(kind).json_schema()) == words


def test_the_words_for_a_table_name_its_keys():
    axis = "a table { velocity, acceleration, deceleration, jerk }"
    assert takes(node_at(("limits", "linear"))) == axis


def test_words_are_added_where_a_key_takes_less_than_its_type():
    assert constraint(node_at(("serial", "port"))) == ""
    assert constraint(node_at(("serial", "dtr"))) == ""
    assert (
        constraint(node_at(("serial", "baudrate"))) == " Takes a whole number from 1200 to 4000000."
    )
    assert constraint(node_at(("serial",))) == ""


def test_a_place_leads_through_tables_of_names_and_lists():
    assert (
        takes(node_at(("chassis", "motors", "left", 0, "position"))) == "a whole number from 1 to 4"
    )
    assert takes(node_at(("command", "sources", "any/thing", "timeout_s"))).startswith("a number")
    assert takes(node_at(("zenoh", "listen", 3))).startswith("an endpoint")


def test_every_place_can_be_looked_up():
    found = places()
    assert ("chassis", "motors", "*", "*", "position") in found
    assert all(takes(node_at(place)) for place in found)


def test_tables_in_tables_are_found():
    motors = entry_table(node_at(("chassis", "motors")))
    assert motors is not None
    assert "position" in motors["properties"]
    assert entry_table(node_at(("chassis", "wheel_radius_multiplier"))) is None
