from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from yahboomd.core.config import Config, read, read_foreign
from yahboomd.core.errors import ConfigError


def test_a_config_with_five_mistakes_names_all_five(complaints):
    lines = complaints(
        """\
[serial]
prot = "/dev/ttyUSB0"
[chassis]
wheel_separation_m = "wide"
wheel_radius_m = -0.03
[chassis.motors]
left = [{ position = 1 }]
right = [{ position = 1 }]
[command]
timeout_s = 0.3
resend_s = 0.4
"""
    )
    assert [line.split(": ", 2) for line in lines] == [
        ["config.toml:2", "serial.prot", 'unknown key; did you mean "port"?'],
        [
            "config.toml:4",
            "chassis.wheel_separation_m",
            'expected a number greater than 0 and at most 5, got "wide"',
        ],
        [
            "config.toml:5",
            "chassis.wheel_radius_m",
            "expected a number greater than 0 and at most 1, got -0.03",
        ],
        [
            "config.toml:8",
            "chassis.motors.right[0].position",
            "position 1 is taken by chassis.motors.left[0]",
        ],
        [
            "config.toml:11",
            "command.resend_s",
            "expected less than command.timeout_s (0.3), got 0.4",
        ],
    ]


def test_mistakes_of_every_layer_are_named_with_their_source(complaints):
    lines = complaints(
        "[log]\nlevel = 3\n",
        "command.rate_hz=fast",
        "nonsense",
        YAHBOOMD_ZENOH__MODE="boss",
    )
    assert [line.split(": ")[0] for line in lines] == [
        "config.toml:2",
        "YAHBOOMD_ZENOH__MODE",
        "--set command.rate_hz",
        "--set nonsense",
    ]


def test_mistakes_in_environment_show_beside_a_file_that_is_no_toml(complaints):
    lines = complaints("[serial\n", YAHBOOMD_LOG__LEVEL="loud")
    assert len(lines) == 2
    assert lines[0].startswith("config.toml:1: not valid TOML: Expected")
    assert lines[1].startswith("YAHBOOMD_LOG__LEVEL: log.level: expected")


def test_a_config_error_ends_with_ex_config(given):
    with pytest.raises(ConfigError) as refused:
        given("[serial]\nbaudrate = true\n")
    assert refused.value.exit_code == os.EX_CONFIG == 78


def test_set_wins_over_environment_over_file_over_default(given):
    text = '[zenoh]\nnamespace = "file"\nencoding = "msgpack"\n[command]\nresend_s = 0.2\n'
    config = given(
        text,
        "zenoh.namespace=set",
        YAHBOOMD_ZENOH__NAMESPACE="environment",
        YAHBOOMD_COMMAND__RESEND_S="0.15",
    ).config
    assert config.zenoh.namespace == "set"
    assert config.command.resend_s == 0.15
    assert config.zenoh.encoding == "msgpack"
    assert config.zenoh.mode == "router"


def test_contradictions_are_reported_beside_an_unknown_section(complaints):
    lines = complaints("[nonsense]\nkey = 1\n[command]\nresend_s = 0.4\n")
    assert [line.split(": ")[1] for line in lines] == ["nonsense", "command.resend_s"]


def test_a_table_of_an_override_replaces_what_was_written_in_it_before(complaints):
    (line,) = complaints("[limits]\nlinear = { velocity = 1 }\n", "limits.linear={velocity=0}")
    assert line.startswith("--set limits.linear: limits.linear.velocity: expected")
    (line,) = complaints("", "ros2.joint_names.left=7", "ros2.joint_names={left=8}")
    assert line.startswith("--set ros2.joint_names: ros2.joint_names.left: expected")


def test_the_last_of_two_overrides_wins(given):
    assert given("", "zenoh.namespace=a", "zenoh.namespace=b").config.zenoh.namespace == "b"


def test_a_value_that_an_override_replaces_is_not_blamed(given):
    assert given("[command]\nrate_hz = 0\n", "command.rate_hz=20").config.command.rate_hz == 20.0


@pytest.mark.parametrize("text", ["7", "2024-01-01", "true", '"7"'])
def test_text_may_look_like_another_type_in_environment_and_set(given, text):
    config = given("", f"zenoh.namespace={text}", YAHBOOMD_BOARD__PROFILE="520").config
    assert config.zenoh.namespace == text.strip('"')
    assert config.board.profile == "520"


@pytest.mark.parametrize(
    "text",
    ['["tcp/[::1]:1", "udp/[::1]:2"]', "[tcp/[::1]:1, udp/[::1]:2]", "tcp/[::1]:1,udp/[::1]:2"],
)
def test_a_list_of_texts_needs_no_quotes_in_environment_and_set(given, text):
    expected = ("tcp/[::1]:1", "udp/[::1]:2")
    assert given("", f"zenoh.listen={text}").config.zenoh.listen == expected
    assert given("", YAHBOOMD_ZENOH__LISTEN=text).config.zenoh.listen == expected


def test_an_empty_text_is_an_empty_list(given):
    assert given("", "zenoh.connect=").config.zenoh.connect == ()


def test_a_list_without_quotes_is_checked_all_the_same(complaints):
    (line,) = complaints("", "zenoh.listen=tcp/127.0.0.1")
    assert "zenoh.listen[0]: its address is not host:port" in line


@pytest.mark.parametrize(
    "text", ["[limits]\nlinear = { velocity = 0.5 }\n", "[limits.linear]\nvelocity = 0.5\n"]
)
def test_a_limit_in_a_file_keeps_the_other_limits_of_its_axis(given, text):
    limits = given(text).config.limits
    assert limits.linear.velocity == 0.5
    assert limits.linear.acceleration == 2.5
    assert limits.linear.deceleration == 5.0
    assert limits.linear.jerk is None
    assert limits.angular == Config().limits.angular


def test_a_single_key_of_an_override_leaves_the_rest_of_its_table(given):
    config = given("", "limits.linear.velocity=0.5", 'command.sources."cmd_vel/teleop".priority=5')
    assert config.config.limits.linear.acceleration == 2.5
    assert config.config.command.sources["cmd_vel/teleop"].priority == 5
    assert config.config.command.sources["cmd_vel/teleop"].timeout_s == 0.3
    assert "cmd_vel" in config.config.command.sources


def test_sources_in_a_file_replace_the_default_ones(given):
    assert list(given("[command.sources.joy]\npriority = 1\n").config.command.sources) == ["joy"]


def test_without_a_file_the_standard_one_is_read_if_it_exists(tmp_path):
    standard = tmp_path / "config.toml"
    assert read(None, environ={}, standard_path=standard).path is None
    standard.write_text('[zenoh]\nnamespace = "bot1"\n')
    loaded = read(None, environ={}, standard_path=standard)
    assert loaded.config.zenoh.namespace == "bot1"
    assert loaded.path == standard


def test_a_file_that_is_named_must_exist(tmp_path):
    missing = tmp_path / "missing.toml"
    with pytest.raises(ConfigError, match=r"missing\.toml: cannot be read: No such file"):
        read(missing, environ={}, overrides=[])


def test_an_empty_file_is_the_defaults(given):
    assert given("").config == Config()


def test_a_preset_is_written_out_with_its_origin(given):
    loaded = given("[chassis]\npreset = '4wd'\n")
    assert loaded.config.chassis.kinematics == "skid_steer"
    assert [len(motors) for motors in loaded.config.chassis.motors.values()] == [2, 2]
    assert loaded.origins[("chassis", "motors")].words.endswith("config.toml:2")


def test_a_key_whose_value_is_wrong_is_not_blamed_by_the_rules_as_well(complaints):
    lines = complaints('[chassis]\nkinematics = "mecanun"\nwheel_base_m = 0.2\n')
    assert len(lines) == 1
    assert lines[0].startswith("config.toml:2: chassis.kinematics: expected")


def test_a_contradiction_is_found_where_a_person_wrote_it(complaints):
    assert complaints("", "chassis.kinematics=mecanum")[-1].startswith(
        "--set chassis.kinematics: chassis.wheel_base_m: missing"
    )


def test_what_works_and_may_surprise_is_a_warning_with_its_place(given):
    (warning,) = given("[limits]\nlinear = { velocity = 1.5 }\n").warnings
    assert "config.toml:2: limits.linear.velocity: 1.5 m/s is more than the board" in warning


def test_entries_of_lists_that_lack_something_are_named(complaints):
    text = "[chassis.motors]\nleft = [{ command_sign = 2 }]\nright = 3\n"
    lines = complaints(text)
    assert [line.split(":")[2].strip() for line in lines] == [
        "chassis.motors.left[0].command_sign",
        "chassis.motors.left[0].position",
        "chassis.motors.right",
    ]


toml_values = st.recursive(
    st.one_of(
        st.integers(),
        st.floats().map(repr),
        st.sampled_from(["true", '""', '"left"', "[]", "{}", "1979-05-27", "0x" + "f" * 5000]),
        st.text(max_size=5),
    ),
    lambda inner: st.one_of(
        inner.map("[{}]".format),
        inner.map("{{ position = {} }}".format),
        inner.map("{{a={}}}".format),
    ),
    max_leaves=3,
)
places = st.sampled_from(
    [f"{name}.{key}" for name, section in vars(Config()).items() for key in vars(section)]
    + ["chassis.motors.left", "command.sources.x.priority", "limits.linear.jerk", "a.b", "zenoh"]
)


def attempt(path: Path | None, **how) -> Config | str:
    try:
        return read(path, environ={}, **how).config
    except ConfigError as error:
        return error.message


@settings(max_examples=25)
@given(st.lists(st.tuples(places, toml_values), max_size=4))
def test_any_value_at_any_key_gives_a_config_or_a_config_error(pairs):
    lines = [f"{place} = {value}" for place, value in pairs]
    outcome = attempt(None, overrides=lines, standard_path=Path("/nonexistent"))
    assert isinstance(outcome, Config) or len(outcome.split("\n")) > 1


@settings(
    max_examples=15,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(st.one_of(st.binary(), st.lists(st.tuples(places, toml_values), max_size=4)))
def test_any_file_gives_a_config_or_a_config_error(tmp_path, content):
    if isinstance(content, list):
        content = "\n".join(f"{place} = {value}" for place, value in content).encode(
            errors="replace"
        )
    path = tmp_path / "fuzzed.toml"
    path.write_bytes(content)
    outcome = attempt(path)
    assert isinstance(outcome, Config) or "fuzzed.toml" in outcome


def test_the_configuration_of_another_version_is_refused_with_what_differs():
    data = Config().as_data()
    assert read_foreign(data, "The daemon") == Config()
    assert read_foreign({"version": "0.2.0", **data}, "The daemon") == Config()
    data["serial"]["colour"] = "red"
    with pytest.raises(ConfigError, match=r"^The daemon has a .* use: serial\.colour: .*same"):
        read_foreign(data, "The daemon")
    with pytest.raises(ConfigError, match=r"of version 0\.2\.0 that yahboomd .* cannot use"):
        read_foreign({"version": "0.2.0", **data}, "The daemon")
    with pytest.raises(ConfigError):
        read_foreign(None, "The daemon")
