"""A process that forks daemons, each to be killed: their modules are imported once.

Its arguments are those of ``--set``. For each line on standard input it starts a daemon and prints
its process id.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
import sys

from yahboomd.blackbox.box_keeper import BoxKeeper
from yahboomd.core.config import read
from yahboomd.core.daemon.service import Daemon
from yahboomd.ros2.ros2_plane import Ros2Plane

PR_SET_PDEATHSIG = 1


def main() -> None:
    config = read(None, environ={}, overrides=sys.argv[1:]).config
    libc = ctypes.CDLL(None)
    # The kernel buries them.
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    for _ in sys.stdin:
        pid = os.fork()
        if pid == 0:
            libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            asyncio.run(
                Daemon(config, environ=os.environ, black_box=BoxKeeper, planes=(Ros2Plane(),)).run()
            )
            os._exit(0)
        print(pid, flush=True)


if __name__ == "__main__":
    main()
