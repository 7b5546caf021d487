"""A report is written whatever the commands do that it asks."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from yahboomd.tools.report import trouble_report
from yahboomd.tools.report.trouble_report import write_report

pytestmark = pytest.mark.realtime


def test_a_command_that_hangs_or_is_not_there_is_a_fact_of_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trouble_report, "PATIENCE_S", 0.2)
    monkeypatch.setattr(trouble_report, "QUESTIONS", {"hangs": ("simulate",)})
    monkeypatch.setattr(trouble_report, "JOURNAL", ("/no/journalctl",))
    path = tmp_path / "report.zip"
    write_report(path, lambda _: ["--link", str(tmp_path / "board")], ("a.blackbox", b"1"), print)
    with zipfile.ZipFile(path) as file:
        assert "did not end within" in file.read("hangs.txt").decode()
        assert "could not be started" in file.read("journal.txt").decode()
        assert file.read("a.blackbox") == b"1"
