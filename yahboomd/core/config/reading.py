"""Reads files that a person named, which may turn out to be anything: pipes, devices, folders."""

from __future__ import annotations

import errno
import os
import select
import stat
from pathlib import Path

PIPE_S = 5.0
"""The longest wait for a pipe or a device: the start must not hang silently."""


def read_named(path: Path, most: int, *, wait_s: float = PIPE_S) -> bytes:
    """The first ``most`` bytes of a file, or of a pipe once something is written to it.

    Args:
        wait_s: The longest wait for the next bytes of a pipe or device; 0 refuses it.

    Raises:
        OSError: It cannot be read. Its ``strerror`` has the reason.
    """
    # Without O_NONBLOCK a named pipe would be opened only when somebody writes to it.
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        ordinary = stat.S_ISREG(os.fstat(fd).st_mode)
        if not ordinary and not wait_s:
            raise OSError(errno.EINVAL, "it is no ordinary file")
        data, ready = b"", ordinary
        while len(data) < most:
            try:
                part = os.read(fd, most - len(data))
            except BlockingIOError:
                part, ready = b"", False
            else:
                # A pipe without a writer reads as ended, before its writer came and after it left.
                ready = ready or bool(data)
            data += part
            if part:
                continue
            if ready:
                break
            if not select.select([fd], [], [], wait_s)[0]:
                words = f"nothing was written to this pipe or device for {wait_s:g} s"
                raise TimeoutError(errno.ETIMEDOUT, words)
            ready = True
        return data
    finally:
        os.close(fd)
