from __future__ import annotations

from pathlib import Path

import pytest

from yahboomd.cli.main import main
from yahboomd.client.services import person_in

FARM = """
fleet = "farm"
[sites.north]
router = "north.example:7447"
[robots.bot1]
site = "north"
[people.vera]
role = "viewer"
[people.dan]
role = "driver"
"""


@pytest.fixture
def file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    path = tmp_path / "farm.toml"
    path.write_text(FARM)
    assert main(["fleet", "init", str(path)]) == 0
    printed = capsys.readouterr().out
    assert f"  {tmp_path}/farm/routers/north.json5\n" in printed
    return path


def test_a_persons_file_has_the_name_that_clients_use_and_no_robots_or_routers_file_has_one(
    file: Path,
) -> None:
    made = file.parent / "farm"
    assert person_in(made / "people/dan.json5") == "dan"
    assert person_in(made / "robots/bot1.json5") == ""
    assert person_in(made / "routers/north.json5") == ""


def test_check_prints_what_a_certificate_may_do_and_until_when(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fleet", "check", str(file), "dan"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("person.dan, until 2")
    assert second == "  bot1 by the site's router: watch, ask, stop, drive, move, hold a move"


def test_revoke_prints_the_files_to_copy_and_until_when_older_ones_accept_the_certificate(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fleet", "revoke", str(file), "dan"]) == 0
    words, *listed = capsys.readouterr().out.splitlines()
    assert "older file accepts the certificate until it ends, 2" in words
    assert listed[1:] == [f"  {file.parent}/farm/routers/north.json5"]
    assert main(["fleet", "check", str(file), "dan"]) == 0
    assert "person.dan is revoked" in capsys.readouterr().out
    assert main(["fleet", "add", str(file)]) == 0
    nothing, refused = capsys.readouterr().out.splitlines()
    assert main(["fleet", "renew", str(file), "dan"]) == 0
    assert capsys.readouterr().out.splitlines() == [nothing, refused]
    # Whoever lost the list gets all files that could still have the name in them.
    assert main(["fleet", "revoke", str(file), "dan"]) == 0
    again = capsys.readouterr().out
    assert "It was revoked before." in again
    assert f"  {file.parent}/farm/routers/north.json5\n" in again
    assert nothing == "Nothing has changed."
    assert refused.startswith("person.dan is revoked and gets nothing")


def test_add_and_renew_print_the_files_that_they_wrote(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file.write_text(FARM + '[robots.bot2]\nsite = "north"\n')
    assert main(["fleet", "add", str(file)]) == 0
    printed = capsys.readouterr().out
    assert "robots/bot2.json5" in printed
    assert "robots/bot1.json5" not in printed
    assert main(["fleet", "renew", str(file)]) == 0
    assert capsys.readouterr().out == "Nothing has changed.\n"
    assert main(["fleet", "renew", str(file), "bot1"]) == 0
    assert capsys.readouterr().out.splitlines()[1:] == [f"  {file.parent}/farm/robots/bot1.json5"]
    assert main(["fleet", "renew", str(file), "--within", "90"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 6


def test_a_mistake_ends_with_78(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fleet", "check", str(file), "eve"]) == 78
    assert main(["fleet", "init", str(file)]) == 78
    file.write_text("fleet = 3")
    assert main(["fleet", "add", str(file)]) == 78
    assert "Expected `str`, got `int`" in capsys.readouterr().err
