"""Requests on local sockets: real ones, with a daemon's side written here."""

from __future__ import annotations

import socket
import threading
from pathlib import Path

import pytest
from real_robot import wait_for

from yahboomd.tools.stop.stop_talk import Talk, converse

pytestmark = pytest.mark.realtime


def answering(path: Path, *answers: bytes) -> threading.Thread:
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(path))
    listening.listen()

    def serve() -> None:
        with listening, listening.accept()[0] as connection:
            connection.recv(100)
            for each in answers:
                connection.sendall(each)

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


def test_lines_come_whole_however_they_are_cut_and_what_is_no_object_is_left_out(
    tmp_path: Path,
) -> None:
    noise = b"noise\n" + b"[" * 5000
    answers = (b'{"daemon": "yah', b'boomd"}\n[1]\n' + noise + b'\n{"stood": true}\n')
    thread = answering(tmp_path / "a", *answers)
    talk = Talk(str(tmp_path / "a"), b"status\n")
    converse([talk], lines=2, within_s=20.0)
    thread.join()
    talk.close()
    assert talk.connected
    assert talk.lines == [{"daemon": "yahboomd"}, {"stood": True}]


def test_one_that_is_silent_delays_no_other(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as silent:
        silent.bind(str(tmp_path / "silent"))
        silent.listen()
        thread = answering(tmp_path / "a", b'{"engaged": true}\n')
        talks = [Talk(str(tmp_path / name), b"stop\n") for name in ("silent", "a")]

        def end_the_silence() -> None:
            wait_for(lambda: talks[1].lines, "the answer of the other")
            silent.accept()[0].close()

        ending = threading.Thread(target=end_the_silence)
        ending.start()
        converse(talks, lines=1, within_s=120.0)
        for each in (thread, ending):
            each.join()
        for talk in talks:
            talk.close()
    assert [talk.lines for talk in talks] == [[], [{"engaged": True}]]


def test_a_path_that_is_too_long_for_the_kernel_is_reached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / ("deep" * 40)
    folder.mkdir()
    monkeypatch.chdir(folder)
    thread = answering(Path("a"), b'{"engaged": true}\n')
    talk = Talk(str(folder / "a"), b"stop\n")
    converse([talk], lines=1, within_s=20.0)
    thread.join()
    talk.close()
    assert talk.lines == [{"engaged": True}]


def test_a_path_without_a_daemon_has_ended(tmp_path: Path) -> None:
    talk = Talk(str(tmp_path / "missing"), b"stop\n")
    converse([talk], lines=1, within_s=20.0)
    talk.close()
    assert talk.ended
    assert not talk.connected
