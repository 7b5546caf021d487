from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from yahboomd.cli.main import main


@pytest.fixture
def start() -> Iterator[object]:
    processes: list[subprocess.Popen[str]] = []

    def go(*options: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "yahboomd", "simulate", *options],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        processes.append(process)
        return process

    yield go
    for process in processes:
        process.kill()
        process.communicate()


@pytest.mark.cases(1)
@pytest.mark.realtime
@pytest.mark.parametrize(
    ("number", "dialect"),
    [(signal.SIGTERM, "streamed"), (signal.SIGINT, "polled"), (signal.SIGHUP, "streamed")],
)
def test_it_names_its_port_and_ends_cleanly(
    start: object, tmp_path: Path, number: signal.Signals, dialect: str
) -> None:
    link = tmp_path / "board"
    process = start("--dialect", dialect, "--link", str(link), "--truth", str(tmp_path / "t"))
    line = process.stdout.readline()
    assert f"simulated {dialect} board" in line
    assert f"yahboomd run --port {link}" in line
    assert str(link.readlink()) in line
    process.send_signal(number)
    assert process.wait(60) == 0
    assert process.stderr.read() == ""
    assert not os.path.lexists(link)
    assert (tmp_path / "t").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--wheel-radius", "0"], "wheel_radius_m must be positive"),
        (["--lines", "9" * 400], "lines must be positive, up to 1e+09, not 999"),
        (["--tick-period", "1e300"], "tick_period_s cannot be 1e+300"),
        (["--loss", "2"], "loss is a share"),
        (["--tick-period", "-1"], "tick_period_s cannot be -1.0"),
        (["--ticks", "1,2"], "four whole numbers"),
        (["--ticks", "1,2,3,99999999999"], "32 bits"),
        (["--flash", "colour=1"], "knows no colour"),
        (["--flash", "lines=many"], "--flash: lines takes a whole number, not 'many'."),
        (
            ["--flash", "ratio=2.5", "--flash", "p=x"],
            "--flash: ratio takes a whole number, not '2.5'; p takes a number, not 'x'.",
        ),
        (["--plugs", "1,2,3"], "--plugs takes a plug for each of 2 motors, such as --plugs=1,3"),
        (["--plugs", "1,x"], "not '1,x'"),
        (["--drive", "ackermann", "--plugs", "1"], "each of 2 motors, such as --plugs=2,4"),
        (["--plugs", "1,1"], "two motors share a position"),
        (["--do", "explode"], "unknown command 'explode'"),
        (["--truth", "/nowhere/truth"], "cannot be written to /nowhere/truth: No such file"),
        (["--heard", "/nowhere/heard"], "The bytes of the host cannot be written"),
    ],
)
def test_options_that_cannot_be_used_are_named_with_status_78(
    capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    assert main(["simulate", *options]) == 78
    assert words in capsys.readouterr().err
