from __future__ import annotations

import tomllib

import pytest

from yahboomd.config import Config, read
from yahboomd.config.writing import as_toml, constraint, doc, entry_model, inline

UNUSUAL = {
    "chassis": {
        "kinematics": "mecanum",
        "wheel_base_m": 0.17,
        "wheel_radius_m": 1e-5,
        "motors": {
            "front_left": [{"position": 4, "name": "a", "encoder_sign": -1}],
            "rear_left": [{"position": 3}],
            "front_right": [{"position": 2}],
            "rear_right": [{"position": 1}],
        },
    },
    "limits": {"linear": {}, "angular": {"jerk": 3}},
    "command": {"sources": {}},
    "zenoh": {"listen": [], "namespace": "größe"},
    "serial": {"port": 'a "quoted" \\ port\n'},
    "ros2": {
        "joint_names": {"a": "joint"},
        "static_transforms": [{"parent": "base_link", "child": "laser", "yaw": -1.5}],
    },
}


@pytest.mark.parametrize("sections", [{}, UNUSUAL])
@pytest.mark.parametrize("with_origins", [False, True])
def test_what_is_shown_reads_back_as_the_same_configuration(write, sections, with_origins):
    config = Config.model_validate(sections)
    text = as_toml(config, origins={} if with_origins else None, header="with a header\n\nof two")
    assert read(write(text), environ={}).config == config


def test_every_key_stands_in_the_file_with_its_description_above():
    text = as_toml(Config())
    flat = " ".join(line.removeprefix("#").strip() for line in text.split("\n")).split()
    words = " ".join(flat)
    for name, info in Config.model_fields.items():
        assert f"[{name}]" in text
        for key, entry in info.annotation.model_fields.items():
            assert " ".join(entry.description.split()) in words, key
            assert any(
                line.removeprefix("# ").startswith((f"{key} = ", f"[{name}.{key}"))
                for line in text.split("\n")
            ), key


def test_optional_keys_become_valid_when_their_comment_is_taken_off():
    lines = as_toml(Config()).split("\n")
    keys = [line[2:] for line in lines if line.startswith(("# wheel_", "# ratio"))]
    assert len(keys) == 4
    assert tomllib.loads("\n".join(keys))["wheel_base_m"] == 0.17


def test_every_value_is_followed_by_its_origin(given):
    loaded = given(
        "[limits]\nlinear = { velocity = 0.5 }\n",
        "limits.linear.jerk=3",
        YAHBOOMD_LOG__LEVEL="debug",
    )
    text = as_toml(loaded.config, origins=loaded.origins)
    (linear,) = [line for line in text.split("\n") if line.startswith("linear = ")]
    assert linear.startswith(
        "linear = { velocity = 0.5, acceleration = 2.5, deceleration = 5.0, jerk = 3.0 }"
        "  # --set limits.linear.jerk=3"
    )
    assert linear.endswith("config.toml:2")
    assert 'level = "debug"  # YAHBOOMD_LOG__LEVEL' in text
    assert 'mode = "router"  # default' in text


def test_comments_fit_the_width():
    assert max(len(line) for line in as_toml(Config()).split("\n") if line.startswith("#")) <= 100


def test_words_are_added_where_a_key_takes_less_than_its_type():
    fields = Config.model_fields["serial"].annotation.model_fields
    assert constraint(fields["port"]) == ""
    assert constraint(fields["dtr"]) == ""
    assert constraint(fields["baudrate"]) == "a whole number from 1200 to 4000000"
    assert constraint(Config.model_fields["serial"]) == ""


def test_tables_in_tables_are_found():
    fields = Config.model_fields["chassis"].annotation.model_fields
    assert entry_model(fields["motors"]).__name__ == "MotorEntry"
    assert entry_model(fields["wheel_radius_multiplier"]) is None


def test_a_table_is_explained_by_its_docstring():
    assert doc(Config.model_fields["serial"].annotation) == "The serial port of the board."


def test_values_are_written_as_toml():
    value = {"a b": [True, 1, 1.5, "x"], "c": {}}
    assert inline(value) == '{ "a b" = [true, 1, 1.5, "x"], c = {} }'
