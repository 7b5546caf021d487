"""`yahboomd call` of a real daemon."""

from __future__ import annotations

import io
import json
import types
from collections.abc import Callable

import pytest

from yahboomd.cli import call
from yahboomd.cli.main import main

pytestmark = [pytest.mark.realtime, pytest.mark.xdist_group("one_robot")]


def test_the_answer_is_a_line_of_json(on_robot: Callable[..., int], capsys) -> None:
    assert on_robot("call", "config") == 0
    said = capsys.readouterr().out
    assert said.count("\n") == 1
    answer = json.loads(said)
    assert answer["success"] is True
    assert "chassis" in answer["data"]


def test_a_request_is_sent_along(on_robot: Callable[..., int], capsys) -> None:
    assert on_robot("call", "odometry/set_pose", '{"x": 3, "y": 0, "theta": 0}') == 0
    assert "x 3 m" in json.loads(capsys.readouterr().out)["message"]
    assert on_robot("call", "yahboomd/odometry/reset") == 0


def test_a_request_is_read_from_standard_input(
    on_robot: Callable[..., int], monkeypatch, capsys
) -> None:
    given = types.SimpleNamespace(buffer=io.BytesIO(b'{"x": 4, "y": 0, "theta": 0}\n'))
    monkeypatch.setattr(call.sys, "stdin", given)
    assert on_robot("call", "odometry/set_pose", "-") == 0
    assert "x 4 m" in capsys.readouterr().out
    assert on_robot("call", "odometry/reset") == 0


def test_a_refusal_is_printed_and_ends_with_1(on_robot: Callable[..., int], capsys) -> None:
    assert on_robot("call", "odometry/set_pose", '{"x": 1}') == 1
    assert json.loads(capsys.readouterr().out)["success"] is False


def test_with_a_persons_file_a_robot_that_does_not_know_the_name_is_asked_without_it(
    on_robot: Callable[..., int], tmp_path, capsys
) -> None:
    papers = tmp_path / "anna.json5"
    papers.write_text('{"metadata": {"yahboomd_fleet": {"person": "anna"}}}')
    by_anna = ("--set", f'zenoh.config="{papers}"')
    assert on_robot("call", "odometry/reset", *by_anna) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["success"] is True
    own = "yahboomd/odometry/reset/by/anna"
    assert said.err == f"Asked without a proven name: nothing answers on {own}.\n"
    # A service that changes nothing has one key.
    assert on_robot("call", "config", *by_anna) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("service", ["**", "odometry/*", "yahboomd/**", "nothing", "status", ""])
def test_only_services_are_called(service: str, capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(["call", service])
    assert left.value.code == 2
    assert "odometry/set_pose" in capsys.readouterr().err


@pytest.mark.parametrize("request_text", ["{", "[1]", "1", "{'x': 1}", "[" * 5000])
def test_a_request_that_is_no_object_is_a_mistake(request_text: str, capsys) -> None:
    with pytest.raises(SystemExit) as left:
        main(["call", "config", request_text])
    assert left.value.code == 2
    assert "no JSON object" in capsys.readouterr().err
