from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import CodeType

import pytest

from yahboomd.core.config import Config, read
from yahboomd.core.config.values import Section
from yahboomd.tools.schemas.reference import as_toml, default_toml, markdown, summary

ROOT = Path(__file__).parents[2]


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
    for name, section in vars(Config()).items():
        part = page.split(f"## `[{name}]`")[1].split("\n## ")[0]
        for key in vars(section):
            assert f"| `{key}` |" in part


SECTIONS = ("hardware.py", "driving.py", "outputs.py", "rules.py")
"""The files that define keys and compare them with each other."""


def names(section: object) -> Iterator[str]:
    """Every key below a section."""
    for name, value in vars(section).items():
        yield from names(value) if isinstance(value, Section) else [name]


def attributes(code: CodeType) -> Iterator[str]:
    """The names of attributes and globals in a code and in those of its functions."""
    yield from code.co_names
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from attributes(constant)


def test_every_key_is_read_somewhere():
    """A key can be checked and documented, and have no effect."""
    read_beside = {"travel_noise_m"}  # a property beside it makes its square
    files = [path for path in (ROOT / "yahboomd").rglob("*.py") if path.name not in SECTIONS]
    codes = (compile(path.read_text(), path, "exec", dont_inherit=True) for path in files)
    read_somewhere = {name for code in codes for name in attributes(code)}
    assert set(names(Config())) - read_somewhere == read_beside


def test_every_row_of_the_reference_has_four_cells():
    rows = [line for line in markdown().split("\n") if line.startswith("| `")]
    assert len(rows) > 60
    for row in rows:
        if "--set" not in row and "YAHBOOMD_" not in row:
            assert row.replace("\\|", "").count("|") == 5, row


def test_the_summary_says_which_robot_this_is(given):
    text = summary(
        given('[zenoh]\nnamespace = "bot1"\n[chassis]\npreset = "4wd"\nwheel_radius_m = 0.0325\n')
    )
    assert "A skid_steer base, 150 mm between the wheels, wheel radius 32.5 mm" in text
    assert "rear_right on M4" in text
    assert "bot1/cmd_vel/teleop (priority 100), bot1/cmd_vel/web (priority 50), " in text
    assert "bot1/cmd_vel (priority 10)" in text
    assert "Listens on tcp/127.0.0.1:7448, joins tcp/127.0.0.1:7447." in text


def test_the_summary_says_what_was_changed_from_outside(given):
    file = given("[chassis]\nwheel_radius_m = 0.04\n")
    assert summary(file).startswith(f"{file.path}. A")
    loaded = given("", "chassis.wheel_radius_m=0.04", YAHBOOMD_ZENOH__NAMESPACE="bot1")
    changed = "--set chassis.wheel_radius_m, YAHBOOMD_ZENOH__NAMESPACE"
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
    for name, section in vars(Config()).items():
        assert f"[{name}]" in text
        for key, about in type(section).model_fields.items():
            assert " ".join((about.description or "").split()) in words, key
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
        "  # --set limits.linear.jerk"
    )
    assert linear.endswith("config.toml:2")
    assert 'level = "debug"  # YAHBOOMD_LOG__LEVEL' in text
    assert 'mode = "router"  # default' in text


def test_comments_fit_the_width():
    assert max(len(line) for line in as_toml(Config()).split("\n") if line.startswith("#")) <= 100
