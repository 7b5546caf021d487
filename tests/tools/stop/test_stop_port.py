"""The port half of stop: which port, and the words for the outcome."""

from __future__ import annotations

import argparse
import itertools
import os
import pty
import signal
from pathlib import Path

import pytest

from yahboomd.cli.main import main
from yahboomd.core.errors import LinkError, PortBusy, PortMissing
from yahboomd.core.link import port_note
from yahboomd.core.link.line import ReceivedSample
from yahboomd.core.link.port_identity import Device
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.seize import Seized
from yahboomd.core.link.takeover import TakeoverReport
from yahboomd.core.protocol.dialect import FramerCounters
from yahboomd.tools.stop import stop_port
from yahboomd.tools.stop.stop_port import (
    describe,
    end,
    print_report,
    seize_noted_ports,
    seize_port,
    undisturbed,
)


def report(**facts: object) -> TakeoverReport:
    usual: dict[str, object] = {
        "port": "/dev/board",
        "dialect": "streamed",
        "stood": True,
        "cut": False,
        "within_s": 0.234,
        "heard": ReceivedSample(counters=FramerCounters()),
    }
    return TakeoverReport(**(usual | facts))  # type: ignore[arg-type]


def options(**given: object) -> argparse.Namespace:
    return argparse.Namespace(**({"port": None, "config": None, "overrides": []} | given))


def test_a_stop_that_was_seen_says_within_how_long() -> None:
    words = describe(report())
    assert words == (
        "/dev/board (streamed board): the wheels stand, 0.23 s after the first stop frame."
    )


def test_a_stop_by_letting_go_says_that_the_brake_was_not_obeyed() -> None:
    assert "did not obey the brake" in describe(report(cut=True))


def test_wheels_that_still_turn_are_a_case_for_the_switch() -> None:
    assert "switch off the supply" in describe(report(stood=False))


def test_unseen_wheels_are_not_called_standing(capsys: pytest.CaptureFixture[str]) -> None:
    assert "look at the wheels" in describe(report(stood=None))
    silent = describe(report(dialect=None, stood=None))
    assert "whether the wheels stand is unknown" in silent
    assert "No byte came" in silent
    assert print_report(report(stood=None)) is False
    assert capsys.readouterr().out == ""


def test_success_goes_to_the_output_and_failure_where_errors_go(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert print_report(report()) is True
    assert print_report(report(stood=False)) is False
    output = capsys.readouterr()
    assert output.out.count("\n") == 1
    assert output.err.startswith("yahboomd: /dev/board")


def test_what_is_no_port_is_explained() -> None:
    with pytest.raises(PortMissing, match="/nonexistent: there is no such port"):
        seize_port("/nonexistent", None)
    with pytest.raises(LinkError, match="/dev/null: this is no serial port"):
        seize_port("/dev/null", None)


def test_a_port_that_hangs_up_right_after_its_first_stop_is_reported_as_lost(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    board, end_of_line = pty.openpty()
    path = os.ttyname(end_of_line)
    os.close(end_of_line)
    seize = stop_port.seize

    def seize_and_hang_up(*arguments: object, **options: object) -> Seized:
        seized = seize(*arguments, **options)  # type: ignore[arg-type]
        os.close(board)
        return seized

    monkeypatch.setattr(stop_port, "seize", seize_and_hang_up)
    assert main(["stop", "--direct", "--port", path]) == 69
    assert f"{path}: the port went away" in capsys.readouterr().err


def test_the_command_that_ends_the_holders_is_complete() -> None:
    assert end(("yahboomd (pid 12)", "python (pid 7)")) == "kill 12 7"
    assert end(()) == "kill PID"


def test_signals_are_as_before_once_the_stop_is_over() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with undisturbed():
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("state", "warned"), [("R", False), ("DS", False), ("DD", True), ("T", True), ("", True)]
)
def test_a_port_that_a_living_neighbour_holds_is_no_trouble_and_a_frozen_ones_is(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    state: str,
    warned: bool,
) -> None:
    free = Seized(-1, "/dev/free", 115200, 0)

    def seize_noted(note: PortNote) -> Seized:
        if note.path != free.path:
            raise PortBusy("It is held.")
        return free

    states = itertools.chain(state, itertools.repeat(state[-1:]))
    monkeypatch.setattr(stop_port, "seize_noted", seize_noted)
    monkeypatch.setattr(stop_port, "process_state", lambda _pid: next(states))
    monkeypatch.setattr(stop_port, "PATIENCE_S", 0.05)
    monkeypatch.setattr(stop_port, "RETRY_S", 0.01)
    monkeypatch.setenv("RUNTIME_DIRECTORY", str(tmp_path))
    for path, name in (("/dev/free", ""), ("/dev/held", "bot1")):
        device = Device(len(name), "", "")
        note = PortNote(path, 115200, True, False, False, device, os.getpid() + len(name), name)
        assert port_note.write(note, str(tmp_path))
    assert seize_noted_ports() == [free]
    assert ("/dev/held is held" in capsys.readouterr().err) is warned
