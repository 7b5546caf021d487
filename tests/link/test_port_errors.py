"""The error for each kind of trouble with a port, and its words."""

from __future__ import annotations

import errno
import os
import pty
import subprocess
from pathlib import Path

import pytest

from yahboomd.core.errors import LinkError, PortBusy, PortDenied, PortMissing
from yahboomd.core.link import port_errors
from yahboomd.core.link.port_errors import explained, holders, lost, other_readers


@pytest.mark.parametrize(
    ("code", "kind", "remedy"),
    [
        (errno.ENOENT, PortMissing, "plugged in"),
        (errno.ENODEV, PortMissing, "plugged in"),
        (errno.EIO, PortMissing, "plugged in"),
        (errno.EACCES, PortDenied, "dialout"),
        (errno.EBUSY, PortBusy, "stop the other one"),
        (errno.ENOTTY, LinkError, "probe --list"),
        (errno.EINVAL, LinkError, "probe --list"),
    ],
)
def test_every_number_of_the_kernels_is_an_error_that_says_where_and_what_to_do(
    code: int, kind: type[LinkError], remedy: str
) -> None:
    error = explained("/dev/not-there", OSError(code, os.strerror(code)))
    assert type(error) is kind
    assert error.message.startswith("/dev/not-there: ")
    assert remedy in str(error)


def test_who_has_a_port_open_is_named_and_not_ourselves() -> None:
    master, slave = pty.openpty()
    try:
        assert holders(os.ttyname(slave)) == ()
    finally:
        os.close(master)
        os.close(slave)
    assert holders("/dev/not-there") == ()


def test_another_reader_of_our_port_is_named_with_the_remedy() -> None:
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    try:
        with subprocess.Popen(["sleep", "60"], stdin=slave) as reader:
            words = other_readers(path)
            reader.kill()
        assert words == (
            f"{path} is also open in sleep (pid {reader.pid}). "
            "Two readers share the board's answers: end the other."
        )
        assert other_readers(path) == ""
    finally:
        os.close(master)
        os.close(slave)


def test_a_console_on_our_port_is_named_though_its_process_cannot_be_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A Raspberry Pi has one on its UART by default."""
    (tmp_path / "active").write_text("tty0 ttyAMA0\n")
    monkeypatch.setattr(port_errors, "CONSOLES", tmp_path / "active")
    words = other_readers("/dev/ttyAMA0")
    assert words.startswith("/dev/ttyAMA0 is also open in the system's console.")
    assert "take console=ttyAMA0 away" in words
    assert other_readers("/dev/ttyAMA1") == ""


def test_a_lost_port_says_why_where_the_kernel_did() -> None:
    assert lost("/dev/x", None).message == "/dev/x: the port went away."
    error = lost("/dev/x", OSError(errno.ENODEV, "No such device"))
    assert error.message == "/dev/x: the port went away ([Errno 19] No such device)."
