"""Processes that the soak starts beside the daemon: a driver, a flood, and a watch on the machine.

python -m benchmarks.soak.children drive|flood|stalls …
"""

from __future__ import annotations

import json
import os
import sys
import time

import zenoh

ATTACHMENT_BYTES = 15_000_000
PARAMETER_BYTES = 1_000_000

PACES = {
    "large": (1, 0.004),
    "attachment": (1, 0.2),
    "query": (4, 0.05),
    "refusal": (10, 0.002),
}
"""The samples of a burst, and the seconds until the next, by kind of flood."""

STALL_NS = 3_000_000
"""A wait of one millisecond that lasted this much longer is reported."""


def session(endpoint: str) -> zenoh.Session:
    """A client of the daemon that reconnects by itself."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("connect/timeout_ms", "10000")
    config.insert_json5(
        "connect/retry",
        '{"period_init_ms": 50, "period_max_ms": 400, "period_increase_factor": 2}',
    )
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("transport/shared_memory/enabled", "false")
    return zenoh.open(config)


def drive(endpoint: str, key: str, vx: float, wz: float) -> None:
    """Drive until killed, and print the time of each command."""
    payload = json.dumps({"vx": vx, "wz": wz})
    with session(endpoint) as bus:
        while True:
            print(time.monotonic_ns(), flush=True)
            bus.put(key, payload)
            print(time.monotonic_ns(), flush=True)
            time.sleep(0.05)


def flood(endpoint: str, key: str, kind: str) -> None:
    """Publish nonsense, large payloads, or the same command at a high rate, until killed."""
    vx = kind.partition("=")[2]
    payloads = {
        "garbage": [os.urandom(size) for size in range(1, 400)],
        "large": [os.urandom(1 << 20)],
        "attachment": [b'{"vx": 0.2}'],
        "query": [b""],
        "refusal": [b'{"engaged": false}'],
    }.get(kind) or [json.dumps({"vx": float(vx)}).encode()]
    batch, pause_s = PACES.get(kind, (10, 0.0005))
    attachment = os.urandom(ATTACHMENT_BYTES) if kind == "attachment" else None
    parameters = "x" * PARAMETER_BYTES
    sent = 0
    with session(endpoint) as bus:
        print("ready", flush=True)
        due = time.monotonic()
        while True:
            for _ in range(batch):
                if kind == "query":
                    bus.get(f"{key}?{parameters}", lambda _reply: None, timeout=1.0)
                else:
                    bus.put(key, payloads[sent % len(payloads)], attachment=attachment)
                sent += 1
            # 20 kHz by default, as far as this machine can.
            due = max(due + pause_s, time.monotonic() - 0.05)
            time.sleep(max(0.0, due - time.monotonic()))


def stalls() -> None:
    """Print each time for which the machine did not run this process."""
    print("ready", flush=True)
    while True:
        before_ns = time.monotonic_ns()
        time.sleep(0.001)
        late_ns = time.monotonic_ns() - before_ns - 1_000_000
        if late_ns > STALL_NS:
            print(before_ns, late_ns, flush=True)


def main(arguments: list[str]) -> None:
    """Run one of the processes."""
    match arguments:
        case ["drive", endpoint, key, vx, wz]:
            drive(endpoint, key, float(vx), float(wz))
        case ["flood", endpoint, key, kind]:
            flood(endpoint, key, kind)
        case ["stalls"]:
            stalls()
        case _:
            sys.exit(f"unknown: {arguments}")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (KeyboardInterrupt, BrokenPipeError):
        # The parent process ended.
        os._exit(0)
