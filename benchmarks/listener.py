"""Subscribes to all samples of a robot, as an application would: ``... listener ENDPOINT [KEY]``.

At the end it prints how many samples came, by key.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections import Counter

import zenoh
from zenoh.handlers import Callback

from benchmarks.rig import client


def main() -> None:
    heard: Counter[str] = Counter()
    done = threading.Event()
    signal.signal(signal.SIGTERM, lambda _number, _frame: done.set())
    with client(sys.argv[1]) as session:

        def take(sample: zenoh.Sample) -> None:
            heard[str(sample.key_expr)] += 1

        key = sys.argv[2] if len(sys.argv) > 2 else "yahboomd/**"
        session.declare_subscriber(key, Callback(take, indirect=False))
        print("ready", flush=True)
        done.wait()
    for key, count in sorted(heard.items()):
        print(f"{key} {count}", flush=True)


if __name__ == "__main__":
    main()
