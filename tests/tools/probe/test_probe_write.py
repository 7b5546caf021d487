"""Progress and questions while settings are stored."""

from __future__ import annotations

import io
from typing import Any

import pytest

from yahboomd.core.link.storing import StoringStep
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.core.protocol.settings import BoardSettings, SettingWrite
from yahboomd.tools.probe.probe_write import Printed, agreed

WRITE = SettingWrite(
    frame=b"$mline:13#", text="encoder lines 13", reply_to="mline", timeout_s=0.4, resets=False
)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def step(**facts: Any) -> StoringStep:
    usual: dict[str, Any] = {"write": WRITE, "outcome": "stored", "attempts": 1, "took_s": 0.11111}
    return StoringStep(**(usual | {"answer": "Set mline:OK!"} | facts))


def printed(capsys: pytest.CaptureFixture[str], done: StoringStep, lines_now: int = 13) -> str:
    progress = Printed()
    progress.begins(DIALECTS["streamed"], (WRITE,), BoardSettings(lines=11))
    capsys.readouterr()
    progress.stored(done, BoardSettings(lines=lines_now))
    return capsys.readouterr().out.strip()


def test_a_value_is_shown_from_what_to_what(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed(capsys, step()) == "encoder lines   11 -> 13   stored"


def test_a_lost_answer_and_more_than_one_attempt_are_reported(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = printed(capsys, step(answer="", attempts=2))
    assert words.endswith("stored, no answer heard, but read back, 2 attempts")


def test_a_refusal_is_reported_in_the_boards_words(capsys: pytest.CaptureFixture[str]) -> None:
    words = printed(capsys, step(outcome="refused", answer="fail,type error!"), lines_now=11)
    assert words == "encoder lines   11 -> 11   refused, the board answered 'fail,type error!'"


@pytest.mark.parametrize(
    ("typed", "answer"),
    [("y\n", True), ("YES\n", True), ("n\n", False), ("\n", False), ("", False)],
)
def test_a_person_at_a_terminal_is_asked_and_silence_is_no(
    typed: str, answer: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal(typed))
    assert agreed(2) is answer
    output = capsys.readouterr()
    assert "Store these 2 values in the board's flash? [y/N]" in output.err
    assert output.out == ""


def test_a_program_is_not_asked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("n\n"))
    assert agreed(1)
    assert capsys.readouterr().err == ""
