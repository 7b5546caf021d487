"""What a guard is charged with, and how it is started."""

from __future__ import annotations

import json
import os
import sys
from typing import TYPE_CHECKING, NamedTuple, Self

if TYPE_CHECKING:
    from subprocess import Popen

ANSWER = b"\n"
"""The guard has the port, or has closed it."""

_HERE = os.path.dirname(os.path.abspath(__file__))
SCRIPT = os.path.join(_HERE, "guard.py")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(_HERE)))


class Charge(NamedTuple):
    """What a guard needs to know.

    Attributes:
        messages: The descriptor of the owner's messages.
        owner: The owner's process, the parent of the guard.
        lease_s: How long each promise lasts.
        kills: An owner whose promise lapses is killed.
        folder: The folder of the owner's note of its port; empty for none.
        port: The descriptor of the owner's port; -1 if it is not shared.
        stop: The bytes that stop its wheels, in hexadecimal digits.
    """

    messages: int
    owner: int
    lease_s: float
    kills: bool = False
    folder: str = ""
    port: int = -1
    stop: str = ""

    @classmethod
    def of(cls, text: str) -> Self:
        return cls(**json.loads(text))


def start(
    lease_s: float, *, kills: bool = False, folder: str = "", port: int = -1, stop: bytes = b""
) -> tuple[Popen[bytes], int]:
    """Start a guard of this process; returns it, and the pipe for messages to it.

    Raises:
        OSError: It does not start.
    """
    import subprocess

    reading, writing = os.pipe()
    charge = Charge(reading, os.getpid(), lease_s, kills, folder, port, stop.hex())
    try:
        process = subprocess.Popen(  # noqa: S603 - a script of this package
            [
                *(sys.executable, "-I", "-S", SCRIPT, json.dumps(charge._asdict())),
                os.pathsep.join((_ROOT, *sys.path)),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE if port >= 0 else subprocess.DEVNULL,
            pass_fds=(reading, port) if port >= 0 else (reading,),
            # Protects it from Ctrl-C and from a terminal that hangs up.
            start_new_session=True,
        )
    except OSError:
        os.close(writing)
        raise
    finally:
        os.close(reading)
    return process, writing
