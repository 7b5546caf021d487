"""Subscribes to all samples of a robot, as an application would: ``... listener ENDPOINT``."""

from __future__ import annotations

import signal
import sys
import threading

from zenoh.handlers import Callback

from benchmarks.rig import client


def main() -> None:
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda _number, _frame: done.set())
    with client(sys.argv[1]) as session:
        session.declare_subscriber("yahboomd/**", Callback(lambda _sample: None, indirect=False))
        print("ready", flush=True)
        done.wait()


if __name__ == "__main__":
    main()
