"""Reads the configuration in a child process: pydantic takes 10 MB that are never freed."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable
from typing import TypeVar

import msgspec

from yahboomd.core.errors import ConfigError, LimitError, YahboomdError, shortage

T = TypeVar("T")

LOOK_S = 1.0
"""The period at which the child checks that its parent still waits."""


def read_in_child(read: Callable[[], T], kind: type[T]) -> Callable[[], T]:
    """Begin to read in a copy of this process, while this process goes on.

    Args:
        read: Returns the wanted values of the configuration, or raises a ConfigError.
        kind: The type of these values.

    Returns:
        A function that waits for the values and returns them, or raises a ConfigError or a
        LimitError.
    """
    if len(os.listdir("/proc/self/task")) > 1:
        # A copy of a process with threads may wait for one of them for ever.
        return read
    # A starting program may have set SIGCHLD to be ignored, which loses the child's status.
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    parent = os.getpid()
    try:
        reading, writing = os.pipe()
        child = os.fork()
    except OSError:
        # No descriptor, process or memory is left for a child, so read here.
        return read
    if child == 0:
        status = os.EX_SOFTWARE
        try:
            _end_with(parent)
            # If the parent has ended, nothing reads the answer.
            with contextlib.suppress(BrokenPipeError), open(writing, "wb") as pipe:
                answer, status = _answer(read)
                pipe.write(answer)
        except Exception:  # noqa: BLE001 - the same as at the end of a process
            sys.excepthook(*sys.exc_info())
        finally:
            os._exit(status)
    os.close(writing)

    def wait() -> T:
        with open(reading, "rb") as pipe:
            answer = pipe.read()
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        if status == os.EX_CONFIG:
            raise ConfigError(answer.decode())
        if status == os.EX_OSERR:
            raise LimitError(answer.decode())
        if status != os.EX_OK:
            # Not read again here: a pipe is already empty.
            raise YahboomdError(f"The process that reads the configuration ended with {status}.")
        return msgspec.msgpack.decode(answer, type=kind, dec_hook=lambda path, text: path(text))

    return wait


def _answer(read: Callable[[], object]) -> tuple[bytes, int]:
    """The child's answer and its exit status."""
    try:
        return msgspec.msgpack.encode(read(), enc_hook=str), os.EX_OK
    except ConfigError as error:
        return str(error).encode(), os.EX_CONFIG
    except Exception as error:
        if (limit := shortage(error)) is None:
            raise
        return str(limit).encode(), os.EX_OSERR


def _end_with(parent: int) -> None:
    """End when the parent has ended, even while this process waits for a named pipe."""

    def look(*_: object) -> None:
        if os.getppid() != parent:
            os._exit(os.EX_SOFTWARE)

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, LOOK_S, LOOK_S)
