from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from benchmarks import rig

pytestmark = pytest.mark.realtime


def read_until(fd: int, words: bytes) -> bytes:
    heard = b""
    while words not in heard:
        heard += os.read(fd, 4096)
    return heard


def test_the_articles_bridge_says_a_speed_and_at_its_end_zero(tmp_path: Path) -> None:
    master, slave = os.openpty()
    port = rig.free_endpoint().rpartition(":")[2]
    arguments = ("-m", "benchmarks.article", os.ttyname(slave), port, str(tmp_path / "poses"))
    try:
        with rig.Process(*arguments) as process:
            process.says("ready")
            with socket.create_connection(("127.0.0.1", int(port))) as commands:
                commands.sendall(b"[0.3, 0.0]\n")
                assert read_until(master, b"$speed:300,0,300,0#").startswith(b"$mtype:1#")
                process.end()
        read_until(master, b"$speed:0,0,0,0#")
    finally:
        os.close(master)
        os.close(slave)
