from __future__ import annotations

import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

from yahboomd.config import Config, read
from yahboomd.config.reference import default_toml, markdown, schema, summary

ROOT = Path(__file__).parents[2]


def test_the_committed_reference_is_current():
    committed = (ROOT / "docs" / "configuration.md").read_text(encoding="utf-8")
    assert committed == markdown(), "run `make schemas`"


def test_the_config_file_in_the_root_is_the_commented_default():
    path = ROOT / "config.toml"
    assert path.read_text(encoding="utf-8") == default_toml(), "run `make schemas`"
    loaded = read(path, environ={})
    assert loaded.config == Config()
    assert loaded.warnings == ()


def test_the_reference_has_a_row_for_every_key():
    page = markdown()
    for name, info in Config.model_fields.items():
        section = page.split(f"## `[{name}]`")[1].split("\n## ")[0]
        for key in info.annotation.model_fields:
            assert f"| `{key}` |" in section


def test_every_row_of_the_reference_has_four_cells():
    rows = [line for line in markdown().split("\n") if line.startswith("| `")]
    assert len(rows) > 60
    for row in rows:
        if "--set" not in row and "YAHBOOMD_" not in row:
            assert row.replace("\\|", "").count("|") == 5, row


def test_the_schema_accepts_the_default_file_and_refuses_a_mistake():
    validator = jsonschema.Draft202012Validator(json.loads(schema()))
    document = tomllib.loads(default_toml())
    assert list(validator.iter_errors(document)) == []
    document["board"]["profile"] = "521"
    document["serial"]["prot"] = "x"
    document["chassis"]["motors"]["left"][0]["position"] = 5
    document["command"]["sources"]["x"] = {"priority": "high"}
    assert len(list(validator.iter_errors(document))) == 4


def test_every_key_has_a_description():
    definitions = json.loads(schema())["$defs"]
    for name, model in definitions.items():
        for key, entry in model["properties"].items():
            assert entry.get("description", "").endswith("."), f"{name}.{key}"


def test_the_summary_says_which_robot_this_is(given):
    text = summary(
        given('[zenoh]\nnamespace = "bot1"\n[chassis]\npreset = "4wd"\nwheel_radius_m = 0.0325\n')
    )
    assert "A skid_steer base, 150 mm between the wheels, wheel radius 32.5 mm" in text
    assert "rear_right on M4" in text
    assert "bot1/cmd_vel/teleop (priority 100), bot1/cmd_vel (priority 10)" in text
    assert "Listens on tcp/127.0.0.1:7448, joins tcp/127.0.0.1:7447." in text


def test_the_summary_says_what_was_changed_from_outside(given):
    file = given("[chassis]\nwheel_radius_m = 0.04\n")
    assert summary(file).startswith(f"{file.path}. A")
    loaded = given("", "chassis.wheel_radius_m=0.04", YAHBOOMD_ZENOH__NAMESPACE="bot1")
    changed = "--set chassis.wheel_radius_m=0.04, YAHBOOMD_ZENOH__NAMESPACE"
    assert summary(loaded).startswith(f"{loaded.path}, changed by {changed}. A")


@pytest.mark.parametrize("mode", ["client"])
def test_the_summary_of_a_client_listens_on_nothing(given, mode):
    assert "Listens on nothing" in summary(given("", f"zenoh.mode={mode}"))


def test_the_summary_names_motors_that_are_mounted_the_other_way_round(given):
    text = summary(
        given(
            """
            [chassis]
            preset = "4wd"
            motors.left = [{ position = 1, command_sign = -1, encoder_sign = -1 }]
            motors.right = [{ position = 4, encoder_sign = -1 }]
            """
        )
    )
    assert "front_left on M1 (reversed), rear_left on M2, front_right on M3" in text
    assert "rear_right on M4 (encoder reversed)" in text
