from __future__ import annotations

import json

import pytest

from yahboomd.cli.main import main
from yahboomd.tools.schemas import reference


@pytest.fixture
def empty(tmp_path):
    path = tmp_path / "config.toml"
    path.touch()
    return str(path)


@pytest.fixture(autouse=True)
def _no_environment(monkeypatch):
    monkeypatch.setattr("os.environ", {})


def test_check_says_ok_and_which_robot_this_is(empty, capsys):
    assert main(["config", "check", "--config", empty]) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith(f"ok: {empty}. A differential base, 150 mm between the wheels")
    assert shown.err == ""


def test_check_names_every_mistake_and_ends_with_78(tmp_path, capsys):
    path = tmp_path / "config.toml"
    path.write_text("[serial]\nbaudrate = 'fast'\n[nonsense]\n")
    assert main(["config", "check", "--config", str(path), "--set", "log.level=loud"]) == 78
    shown = capsys.readouterr()
    assert shown.out == ""
    head, *lines = shown.err.strip().split("\n")
    assert head == "yahboomd: The configuration has 3 mistakes:"
    assert [line.split(": ")[0] for line in lines] == [
        f"{path}:2",
        f"{path}:3",
        "--set log.level",
    ]


def test_check_warns_of_what_works_and_may_surprise(empty, capsys):
    listen = 'zenoh.listen=["tcp/0.0.0.0:7448"]'
    assert main(["config", "check", "--config", empty, "--set", listen]) == 0
    shown = capsys.readouterr()
    assert shown.out.startswith("ok: ")
    assert shown.err.startswith("warning: ")
    assert "every program that reaches it can drive" in shown.err


def test_check_judges_the_file_of_zenoh_config(empty, tmp_path, capsys):
    file = tmp_path / "zenoh.json5"
    file.write_text("{ transport: { unicast: { lowlatency: true } } }")
    options = ["--config", empty, "--set", f"zenoh.config={file}"]
    assert main(["config", "check", *options]) == 78
    shown = capsys.readouterr()
    assert shown.out == ""
    assert f"{file} cannot be used: transport/unicast/lowlatency: " in shown.err


def test_show_prints_what_can_be_used_as_a_file(empty, tmp_path, capsys):
    assert main(["config", "show", "--config", empty, "--set", "zenoh.namespace=bot1"]) == 0
    shown = capsys.readouterr().out
    again = tmp_path / "again.toml"
    again.write_text(shown)
    assert main(["config", "show", "--config", str(again)]) == 0
    assert capsys.readouterr().out == shown
    assert 'namespace = "bot1"\n' in shown


def test_show_says_where_values_come_from(empty, capsys):
    main(["config", "show", "--origin", "--config", empty, "--set", "zenoh.namespace=bot1"])
    shown = capsys.readouterr().out
    assert 'namespace = "bot1"  # --set zenoh.namespace\n' in shown
    assert 'mode = "router"  # default\n' in shown


def test_reference_is_the_page_or_the_default_file(capsys):
    assert main(["config", "reference"]) == 0
    assert capsys.readouterr().out == reference.markdown()
    assert main(["config", "reference", "--toml"]) == 0
    assert capsys.readouterr().out == reference.default_toml()


def test_show_prints_json_for_programs_with_the_preset_written_out(empty, capsys):
    main(["config", "show", "--json", "--config", empty, "--set", "chassis.preset=4wd"])
    shown = json.loads(capsys.readouterr().out)
    assert shown["chassis"]["kinematics"] == "skid_steer"
    assert shown["ros2"]["publish_tf"] is True


def test_urdf_and_parameters_are_those_of_the_configuration(empty, capsys):
    assert main(["config", "urdf", "--config", empty, "--set", "zenoh.namespace=bot1"]) == 0
    assert '<robot name="bot1">' in capsys.readouterr().out
    limit = "limits.linear={velocity=0.2}"
    assert main(["config", "parameters", "nav2", "--config", empty, "--set", limit]) == 0
    assert "vx_max: 0.2\n" in capsys.readouterr().out
