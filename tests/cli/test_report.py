"""One file with what somebody who helps has to know, whatever is wrong with the robot."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import pytest
from zenoh_fixtures import free_endpoint

from yahboomd import __version__
from yahboomd.cli.main import main
from yahboomd.tools.report import trouble_report
from yahboomd.tools.report.trouble_report import JOURNAL, QUESTIONS

pytestmark = pytest.mark.realtime


def test_its_file_belongs_to_the_person_who_asked_by_sudo(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    monkeypatch.setattr(os, "fchown", lambda _, user, group: given.append((user, group)))
    monkeypatch.setattr(trouble_report, "QUESTIONS", {})
    monkeypatch.setattr(trouble_report, "JOURNAL", ("true",))
    for name, user in (("a", "1000"), ("b", "")):
        monkeypatch.setenv("SUDO_UID", user)
        trouble_report.write_report(tmp_path / name, lambda _: (), None, lambda _: None)
    assert given == [(1000, -1)]


def test_it_has_an_answer_or_the_reason_for_each_question_and_no_way_in(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written, config = tmp_path / "report.zip", tmp_path / "robot.toml"
    config.write_text('[zenoh]\nnamespace = "bot1"\n')
    options = ["--config", str(config), "--connect", free_endpoint(), "--port", "/dev/null"]
    assert main(["report", str(written), *options]) == os.EX_OK
    assert str(written) in capsys.readouterr().out
    assert written.stat().st_mode & 0o777 == 0o600
    with zipfile.ZipFile(written) as file:
        parts = {name: file.read(name).decode() for name in file.namelist() if ".txt" in name}
    assert set(parts) == {f"{name}.txt" for name in (*QUESTIONS, "machine", "journal")}
    assert f"yahboomd {__version__}" in parts["machine.txt"]
    assert "eclipse-zenoh" in parts["machine.txt"]
    assert 'namespace = "bot1"' in parts["config.txt"]
    assert "(exit status 69)" in parts["status.txt"]
    assert "No yahboomd answers" in parts["status.txt"]
    assert "/dev/null" in parts["probe.txt"]
    assert not any("Traceback" in text or "usage:" in text for text in parts.values())
    # The page's log names links that let people in.
    assert not any("yahboomd-web" in word for word in JOURNAL)
    # It is never written over something.
    assert main(["report", str(written)]) == os.EX_CANTCREAT
    assert "Name another file" in capsys.readouterr().err
