"""What a guard does while its disk hangs."""

from __future__ import annotations

import json
import os
import select
import socket
import threading
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from yahboomd.core.daemon.estop.latch_file import LatchFile
from yahboomd.core.link import guard_words, port_note
from yahboomd.core.link.guard_words import Listening
from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.link.promise import Promise, memory
from yahboomd.tools.port import guard_law, local_stops
from yahboomd.tools.port.charge import Charge
from yahboomd.tools.port.guard import Guard

ZERO = b"$spd:0,0,0,0#"


@pytest.fixture
def hangs() -> Iterator[Callable[..., None]]:
    """Work that hangs until the end of the test."""
    until = threading.Event()

    def hang(*_words: object) -> None:
        until.wait()

    yield hang
    until.set()


@pytest.fixture
def guard() -> Iterator[tuple[Guard, Promise, socket.socket]]:
    """One of this process, on a channel."""
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    its.setblocking(False)
    promise = Promise(memory())
    yield Guard(Charge(its.fileno(), 0, os.getppid()), its, promise), promise, ours
    ours.close()
    its.close()


def test_a_hanging_disk_hides_no_lapse(
    guard: tuple[Guard, Promise, socket.socket],
    hangs: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    monkeypatch.setattr(local_stops.LocalStops, "made", hangs)
    far, fd = os.openpty()
    tty.setraw(fd)
    path = os.ttyname(fd)
    note = PortNote(path, 115200, True, False, False, identify(os.stat(path)))
    made, promise, owner = guard
    promise.until_ms = 1
    listening = json.dumps(Listening(str(tmp_path), "stop")).encode()
    owner.send(b"%s %s" % (guard_words.LISTEN, listening))
    words = [guard_words.PORT, b" ", port_note.text_of(note).encode()]
    socket.send_fds(owner, words, [fd])
    owner.send(b"%s %s %s" % (guard_words.STOP, ZERO.hex().encode(), ZERO.hex().encode()))
    serving = threading.Thread(target=made.serve)
    serving.start()
    assert select.select([far], [], [], 60.0)[0]
    assert os.read(far, 4096).startswith(ZERO)
    promise.until_ms = 0
    owner.close()
    serving.join()
    os.close(fd)
    os.close(far)


def test_a_guard_that_waits_for_a_disk_says_so_and_ends_once_the_stop_is_on_file(
    guard: tuple[Guard, Promise, socket.socket], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    written = threading.Event()
    monkeypatch.setattr(LatchFile, "engage", lambda *_: written.wait())
    answers: list[str] = []

    def answer(_stops: object, _number: int, line: bytes) -> None:
        answers.append(json.loads(line)["message"])
        written.set()

    monkeypatch.setattr(local_stops.LocalStops, "answer", answer)
    made, promise, owner = guard
    made._listening = Listening("", "", str(tmp_path / "estop"))
    made._stops.facts = b'{"daemon": "yahboomd", "connected": true, "state": "driving"}'
    promise.asked = 1
    made._take(guard_law.Asked())
    owner.close()
    made.serve()
    assert "It is not on file yet (the disk does not answer)" in answers[0]
    assert "not on file" not in answers[1]
    assert json.loads(made._stops.facts) == {
        "daemon": "yahboomd",
        "connected": False,
        "state": "ended",
        "why": f"yahboomd (pid {os.getppid()}) has ended; its guard stops the wheels.",
    }
