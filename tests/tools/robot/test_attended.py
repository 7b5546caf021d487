"""Ends of a command that works on a robot."""

from __future__ import annotations

import asyncio
import os

import pytest

from yahboomd.cli import attended
from yahboomd.cli.attended import output_watched


class Stdout:
    def __init__(self, number: int) -> None:
        self._number = number

    def fileno(self) -> int:
        return self._number


async def test_the_end_of_a_pipes_reader_is_reported_once(monkeypatch) -> None:
    reading, writing = os.pipe()
    monkeypatch.setattr(attended.sys, "stdout", Stdout(writing))
    ends: list[bool] = []
    gone = asyncio.Event()

    def tell() -> None:
        ends.append(True)
        gone.set()

    with output_watched(tell):
        os.write(writing, b"what is written and read is no end")
        os.read(reading, 10)
        for _ in range(10):
            await asyncio.sleep(0)
        assert ends == []
        os.close(reading)
        await asyncio.wait_for(gone.wait(), 60)
        for _ in range(10):
            await asyncio.sleep(0)
    assert ends == [True]
    os.close(writing)


async def test_files_and_closed_outputs_are_not_watched(monkeypatch, tmp_path) -> None:
    with (tmp_path / "file").open("w") as file:
        for output in (file, open(os.devnull), None):  # noqa: SIM115, ASYNC230
            monkeypatch.setattr(attended.sys, "stdout", output)
            with output_watched(lambda: pytest.fail("gone")):
                await asyncio.sleep(0)
            if output is not None:
                output.close()
