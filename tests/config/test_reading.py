"""Files that a person named, which may be anything."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from yahboomd.core.config.reading import read_named


def test_a_file_is_read_up_to_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x" * 100_000)
    assert read_named(path, 1_000_000) == b"x" * 100_000
    assert read_named(path, 10) == b"x" * 10
    assert read_named(Path("/dev/null"), 10) == b""
    assert read_named(Path("/dev/zero"), 10) == bytes(10)


def test_a_pipe_is_read_to_its_end_though_its_writer_comes_late(tmp_path: Path) -> None:
    """As of `--config <(command)`."""
    path = tmp_path / "pipe"
    os.mkfifo(path)

    def write() -> None:
        with path.open("wb") as pipe:
            for _ in range(100):
                pipe.write(b"x" * 1000)
                pipe.flush()

    writer = threading.Thread(target=write)
    writer.start()
    try:
        assert read_named(path, 1_000_000, wait_s=60.0) == b"x" * 100_000
    finally:
        writer.join()


def test_a_pipe_that_was_written_and_closed_before_is_read_without_waiting() -> None:
    reading, writing = os.pipe()
    os.write(writing, b"all")
    os.close(writing)
    try:
        assert read_named(Path(f"/proc/self/fd/{reading}"), 10, wait_s=60.0) == b"all"
    finally:
        os.close(reading)


def test_a_pipe_without_anything_in_it_is_named_and_hangs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(TimeoutError, match="nothing was written"):
        read_named(path, 10, wait_s=0.01)
    # One that holds it open and is silent does not help.
    silent = os.open(path, os.O_RDWR)
    try:
        with pytest.raises(TimeoutError, match="nothing was written"):
            read_named(path, 10, wait_s=0.01)
    finally:
        os.close(silent)


def test_without_a_wait_only_an_ordinary_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    for other in (path, Path("/dev/zero"), tmp_path):
        with pytest.raises(OSError, match="no ordinary file"):
            read_named(other, 10, wait_s=0.0)
    with pytest.raises(FileNotFoundError):
        read_named(tmp_path / "none", 10, wait_s=0.0)
