from __future__ import annotations

import argparse
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from yahboomd.cli import shared_options
from yahboomd.core.errors import ConfigError


@pytest.fixture
def parse(tmp_path):
    """Parse arguments of a command that has all shared options, with an empty configuration."""
    empty = tmp_path / "config.toml"
    empty.touch()
    parser = argparse.ArgumentParser()
    shared_options.add_config_options(parser)
    shared_options.add_port_option(parser)
    shared_options.add_bus_options(parser)
    shared_options.add_source_option(parser, "cmd_vel/teleop")

    def parsed(*arguments: str) -> argparse.Namespace:
        return parser.parse_args(["--config", str(empty), *arguments])

    return parsed


def test_a_port_and_a_namespace_win_over_set_and_environment(parse):
    args = parse("--port", "/dev/ttyUSB1", "--set", "serial.port=/dev/a", "--namespace", "1.0")
    config = shared_options.read_config(args, {"YAHBOOMD_ZENOH__NAMESPACE": "other"}).config
    assert config.serial.port == "/dev/ttyUSB1"
    assert config.zenoh.namespace == "1.0"


def test_a_daemon_is_reached_where_it_listens_then_at_its_routers(parse):
    args = parse("--set", 'zenoh.listen=["tcp/0.0.0.0:7448", "tcp/[::]:7448"]')
    config = shared_options.read_config(args, {}).config
    assert shared_options.daemon_endpoints(args, config) == (
        "tcp/127.0.0.1:7448",
        "tcp/[::1]:7448",
        "tcp/127.0.0.1:7447",
    )


def test_endpoints_that_are_given_are_used_alone(parse):
    args = parse("--connect", "tcp/10.0.0.1:1", "--connect", "tcp/10.0.0.2:1")
    config = shared_options.read_config(args, {}).config
    assert shared_options.daemon_endpoints(args, config) == ("tcp/10.0.0.1:1", "tcp/10.0.0.2:1")


def test_an_endpoint_that_cannot_work_is_refused_as_an_option(parse, capsys):
    with pytest.raises(SystemExit) as left:
        parse("--connect", "127.0.0.1:7447")
    assert left.value.code == 2
    words = capsys.readouterr().err
    assert "argument --connect: it is not of the form protocol/address" in words
    assert "protocol/address, such as tcp/127.0.0.1:7447" in words


@given(
    st.text(st.characters(min_codepoint=32, exclude_characters="\x7f", exclude_categories=["Cs"]))
)
def test_any_text_is_quoted_as_toml(text):
    assert tomllib.loads(f"text = {shared_options.quoted(text)}")["text"] == text


@pytest.mark.parametrize("text", ["-1", "nan", "3601", "soon", ""])
def test_what_is_no_duration_is_a_mistake(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        shared_options.seconds(text)


@pytest.mark.parametrize("text", ["-1", "-.5", "-8.66e-17", "-1.", "-2E+3"])
def test_negative_numbers_are_values_however_they_are_written(text: str) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--place", nargs=2, type=float)
    shared_options.take_negative_numbers(parser)
    assert parser.parse_args(["--place", text, "1"]).place == [float(text), 1.0]


def test_the_source_is_the_one_that_was_named_or_the_persons_own_or_the_default(parse, tmp_path):
    papers = tmp_path / "anna.json5"
    papers.write_text('{"metadata": {"yahboomd_fleet": {"person": "anna"}}}')
    own = f"zenoh.config={papers}"
    for arguments, source in (
        ([], "cmd_vel/teleop"),
        (["--set", own], "cmd_vel/anna"),
        (["--set", own, "--source", "cmd_vel/joy"], "cmd_vel/joy"),
    ):
        args = parse(*arguments)
        config = shared_options.read_config(args, {}).config
        assert shared_options.source_of(args, config, "cmd_vel/teleop") == source
    with pytest.raises(ConfigError, match="--source"):
        shared_options.source_of(parse("--source", "cmd_vel/**"), config, "cmd_vel")
