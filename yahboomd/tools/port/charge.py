"""What a guard is charged with, and how it is started."""

from __future__ import annotations

import json
import os
import sys
from typing import TYPE_CHECKING, NamedTuple, Self

if TYPE_CHECKING:
    import socket
    from subprocess import Popen

_HERE = os.path.dirname(os.path.abspath(__file__))
SCRIPT = os.path.join(_HERE, "guard.py")
_ROOT = os.path.dirname(os.path.dirname(os.path.dirname(_HERE)))


class Charge(NamedTuple):
    """What a guard needs to know.

    Attributes:
        channel: The descriptor of its socket to the owner.
        promise: The descriptor of the promise's memory.
        owner: The owner's process, the parent of the guard.
        kills: An owner whose promise lapses is killed.
        folder: The folder of the owner's note of its port; empty for none.
    """

    channel: int
    promise: int
    owner: int
    kills: bool = False
    folder: str = ""

    @classmethod
    def of(cls, text: str) -> Self:
        return cls(**json.loads(text))


def start(
    promise: int, *, kills: bool = False, folder: str = ""
) -> tuple[Popen[bytes], socket.socket]:
    """Start a guard of this process; returns it, and a socket for packets to it.

    Args:
        promise: The descriptor of the promise's memory.
        kills: The guard kills this process if a promise lapsed long ago.
        folder: Where the note of the port is.

    Raises:
        OSError: It does not start.
    """
    import socket
    import subprocess

    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with its:
        charge = Charge(its.fileno(), promise, os.getpid(), kills, folder)
        try:
            process = subprocess.Popen(  # noqa: S603 - a script of this package
                [
                    *(sys.executable, "-I", "-S", SCRIPT, json.dumps(charge._asdict())),
                    os.pathsep.join((_ROOT, *sys.path)),
                ],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                pass_fds=(its.fileno(), promise),
                # Protects it from Ctrl-C and from a terminal that hangs up.
                start_new_session=True,
            )
        except OSError:
            ours.close()
            raise
    return process, ours
