"""A device that was lost is taken when it is back: the device, and not its name."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.core.link.port_identity import identify
from yahboomd.core.link.port_note import PortNote
from yahboomd.core.protocol.first_words import FIRST_WORDS
from yahboomd.tools.stop.last_stop import seize_again


class Board:
    """The far end of a pseudo-terminal, to which a link leads."""

    def __init__(self, link: Path) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self.master, False)
        link.unlink(missing_ok=True)
        link.symlink_to(self.path)

    @property
    def heard(self) -> bytes:
        try:
            return os.read(self.master, 4096)
        except (BlockingIOError, OSError):
            return b""


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "board"


@pytest.fixture
def board(link: Path) -> Iterator[Board]:
    found = Board(link)
    yield found
    os.close(found.master)


def note_of(path: Path | str) -> PortNote:
    return PortNote(str(path), 115200, True, False, False, device=identify(os.stat(path)))


def test_a_device_that_came_back_is_stopped_at_once(board: Board, link: Path) -> None:
    lost = note_of(link)
    # The other way round it may get the same number within the same tick of the kernel's clock.
    back = Board(link)
    os.close(board.master)
    seized = seize_again(lost)
    assert seized.path == str(link)
    words = b"".join(FIRST_WORDS.values())
    os.set_blocking(back.master, True)
    heard = b""
    while len(heard) < len(words):
        heard += os.read(back.master, 4096)
    assert heard == words
    os.close(seized.fd)
    board.master = back.master


def test_another_device_that_has_its_name_now_is_sent_nothing(board: Board) -> None:
    lost = note_of(board.path)
    usb = lost.device._replace(number=os.makedev(188, 250), usb="1-2 1a86:7523")
    for device in (usb, lost.device._replace(node="other")):
        with pytest.raises(FileNotFoundError):
            seize_again(lost._replace(device=device))
    assert board.heard == b""


def test_a_device_that_is_away_is_not_taken(board: Board, link: Path) -> None:
    lost = note_of(link)
    link.unlink()
    with pytest.raises(FileNotFoundError):
        seize_again(lost._replace(device=lost.device._replace(node="gone")))
