"""A long way between two ends on this machine, on which packets are late or lost.

    python -m benchmarks.long_way DELAY_MS LOSS

An interface sends whatever is addressed to FAR back to this machine, as if it came from there: each
packet a time later, some never. So the kernel's own TCP waits, sends again and slows down as it
does over a radio link. It needs root, and belongs into a network namespace of its own:
``unshare --net``.
"""

from __future__ import annotations

import fcntl
import os
import random
import select
import struct
import subprocess
import sys
import time
from collections import deque

HERE, FAR = "10.78.0.1", "10.78.0.2"
"""A connection to FAR ends at HERE."""

_TUNSETIFF = 0x400454CA
_TUN_WITHOUT_HEADER = 0x0001 | 0x1000


def hairpin(packet: bytes) -> bytes:
    """The packet with both addresses swapped, for which its checksums remain right."""
    return packet[:12] + packet[16:20] + packet[12:16] + packet[20:]


def interface() -> int:
    """Make the interface, which is gone when its file is closed."""
    fd = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(fd, _TUNSETIFF, struct.pack("16sH14x", b"wire0", _TUN_WITHOUT_HEADER))
    for words in (f"addr add {HERE}/24 dev wire0", "link set wire0 up", "link set lo up"):
        subprocess.run(["ip", *words.split()], check=True)
    return fd


def carry(fd: int, delay_s: float, loss: float, chance: random.Random) -> None:
    """Carry packets until the process is ended."""
    late: deque[tuple[float, bytes]] = deque()
    while True:
        wait_s = None if not late else max(0.0, late[0][0] - time.monotonic())
        if select.select([fd], [], [], wait_s)[0]:
            packet = os.read(fd, 65536)
            if packet[0] >> 4 == 4 and chance.random() >= loss:
                late.append((time.monotonic() + delay_s, hairpin(packet)))
        while late and late[0][0] <= time.monotonic():
            os.write(fd, late.popleft()[1])


def main() -> None:
    fd = interface()
    print("ready", flush=True)
    carry(fd, float(sys.argv[1]) / 1e3, float(sys.argv[2]), random.Random(1))


if __name__ == "__main__":
    main()
