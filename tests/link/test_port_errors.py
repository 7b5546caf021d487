"""The error for each kind of trouble with a port, and its words."""

from __future__ import annotations

import errno
import os
import pty

import pytest

from yahboomd.core.errors import LinkError, PortBusy, PortDenied, PortMissing
from yahboomd.core.link.port_errors import explained, holders, lost


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


def test_a_lost_port_says_why_where_the_kernel_did() -> None:
    assert lost("/dev/x", None).message == "/dev/x: the port went away."
    error = lost("/dev/x", OSError(errno.ENODEV, "No such device"))
    assert error.message == "/dev/x: the port went away ([Errno 19] No such device)."
