from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from yahboomd.cli.main import main
from yahboomd.client.services import own_source, person_in

FLEET = """
fleet = "farm"
[sites.north]
router = "127.0.0.1:7447"
[robots.bot1]
site = "north"
[people.anna]
role = "operator"
"""


def test_the_name_is_that_of_the_persons_file_and_no_robots_or_routers_file_has_one(
    tmp_path: Path,
) -> None:
    (tmp_path / "fleet.toml").write_text(FLEET)
    assert main(["fleet", "init", str(tmp_path / "fleet.toml")]) == 0
    made = tmp_path / "fleet"
    assert person_in(made / "people/anna.json5") == "anna"
    assert person_in(str(made / "people/anna.json5")) == "anna"
    assert person_in(made / "robots/bot1.json5") == ""
    assert person_in(made / "routers/north.json5") == ""
    assert own_source("anna") == "cmd_vel/anna"
    assert person_in(None) == person_in(made / "absent.json5") == ""


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "no json",
        "[]",
        *(json.dumps({"metadata": {"yahboomd_fleet": each}}) for each in (7, {}, {"person": 7})),
        json.dumps({"metadata": {"yahboomd_fleet": {"person": "**"}}}),
        json.dumps({"metadata": {"yahboomd_fleet": {"person": ""}}}),
    ],
)
def test_a_file_without_a_usable_name_has_none(tmp_path: Path, text: str) -> None:
    path = tmp_path / "zenoh.json5"
    path.write_text(text)
    assert person_in(path) == ""


def test_a_file_that_would_hang_or_end_the_program_proves_no_name(tmp_path: Path) -> None:
    pipe, deep = tmp_path / "pipe.json5", tmp_path / "deep.json5"
    os.mkfifo(pipe)
    deep.write_text("{metadata: " + "[" * 100_000 + "]" * 100_000 + "}")
    assert person_in(pipe) == person_in(deep) == ""
