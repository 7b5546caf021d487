from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from yahboomd.client.services import own_source, person_in


def test_the_name_is_that_of_the_persons_file(tmp_path: Path) -> None:
    papers = tmp_path / "anna.json5"
    papers.write_text('// Keep it secret.\n{"metadata": {"yahboomd_fleet": {"person": "anna"}}}')
    assert person_in(papers) == person_in(str(papers)) == "anna"
    assert own_source("anna") == "cmd_vel/anna"
    assert person_in(None) == person_in(tmp_path / "absent.json5") == ""


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
