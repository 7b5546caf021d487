"""``yahboomd move``: its arguments, its file of points, its bar, and drives of a real daemon."""

from __future__ import annotations

import argparse
import asyncio
import math
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fake_moves import FakeMoves
from zenoh_fixtures import eventually

from make.schema_files.move_samples import SAMPLES
from yahboomd.cli import move
from yahboomd.cli.main import main
from yahboomd.client import Move, MoveSample
from yahboomd.core.bus.bus import Bus
from yahboomd.core.bus.options import BusOptions


def asked(*words: str) -> Move:
    parser = argparse.ArgumentParser()
    move.add_options(parser)
    return move._move(parser.parse_args(words))


def test_the_words_become_the_move() -> None:
    assert asked("straight", "-1") == Move(kind="straight", distance_m=-1.0)
    assert asked("straight", "0", "--left", "0.5") == Move(kind="straight", left_m=0.5)
    assert asked("turn", "-90deg") == Move(kind="turn", angle_rad=-math.pi / 2.0)
    assert asked("turn", "1.5", "--turn-speed", "2") == Move(
        kind="turn", angle_rad=1.5, turn_rad_s=2.0
    )
    assert asked("arc", "0.5", "180deg", "--backward") == Move(
        kind="arc", radius_m=0.5, angle_rad=math.pi, backward=True
    )
    assert asked("goto", "2", "-1") == Move(kind="go_to", x=2.0, y=-1.0)
    assert asked("goto", "2", "-1", "90deg", "--speed", "0.2") == Move(
        kind="go_to", x=2.0, y=-1.0, theta=math.pi / 2.0, speed_m_s=0.2
    )


@pytest.mark.parametrize(
    "words",
    [(), ("fly", "1"), ("straight",), ("straight", "far"), ("arc", "0", "1"), ("goto", "1"),
     ("goto", "0", "0", "90"), ("straight", "1", "--speed", "0"), ("turn", "nan")],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        asked(*words)
    assert capsys.readouterr().err


def test_a_path_is_the_points_of_its_file(tmp_path: Path) -> None:
    file = tmp_path / "way.csv"
    file.write_text("x,y,theta\n1, 2\n3,4,0.5\n")
    assert asked("path", str(file), "--corner", "0.1") == Move(
        kind="follow", points=((1.0, 2.0), (3.0, 4.0, 0.5)), corner_m=0.1
    )


def test_the_bar_shows_what_is_left() -> None:
    sample = SAMPLES["MoveSample"]
    assert isinstance(sample, MoveSample)
    half = msgspec.structs.replace(
        sample, state="running", done=0.5, left_m=0.42, left_rad=0.0, left_s=1.5
    )
    assert move.bar(half) == f"[{'#' * 15}{'.' * 15}]   0.42 m           1.5 s "
    paused = msgspec.structs.replace(half, state="paused", left_rad=math.pi)
    assert "180°" in move.bar(paused)
    assert "paused" in move.bar(paused)


# Beside a daemon and a service that look like real ones.


@pytest.fixture
async def served(fake_daemon: Callable[..., Any]) -> AsyncIterator[tuple[str, FakeMoves]]:
    daemon = await fake_daemon()
    bus = Bus(BusOptions(listen=(), connect=(daemon.endpoint,)))
    await bus.open()
    yield daemon.endpoint, FakeMoves(bus)
    await bus.close()


async def run(endpoint: str, *words: str) -> asyncio.Task[int]:
    arguments = ["move", *words, "--connect", endpoint, "--timeout", "60"]
    return asyncio.create_task(asyncio.to_thread(main, arguments))


@pytest.mark.realtime
async def test_it_waits_for_the_goal_and_ends_with_its_words(
    served: tuple[str, FakeMoves], capfd: pytest.CaptureFixture[str]
) -> None:
    endpoint, moves = served
    running = await run(endpoint, "turn", "90deg")
    await eventually(lambda: len(moves.beats) > 3)
    assert not running.done()
    moves.tell(done=0.5)
    moves.tell(state="ended", reason="reached", message="The goal is reached.")
    assert await running == 0
    assert capfd.readouterr() == ("The goal is reached.\n", "")
    assert moves.requests[0]["by"] == "yahboomd move"


@pytest.mark.realtime
async def test_points_and_metres_of_a_path_are_printed_before_it_is_driven(
    served: tuple[str, FakeMoves], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    endpoint, moves = served
    file = tmp_path / "way.csv"
    file.write_text("0,0\n3,4\n")
    running = await run(endpoint, "path", str(file))
    await eventually(lambda: moves.beats)
    assert capfd.readouterr().out == "2 points, 5.00 m from the first to the last.\n"
    moves.tell(state="ended", reason="reached", message="The goal is reached.")
    assert await running == 0


@pytest.mark.realtime
async def test_a_goal_that_is_not_reached_ends_with_its_words(
    served: tuple[str, FakeMoves], capfd: pytest.CaptureFixture[str]
) -> None:
    endpoint, moves = served
    running = await run(endpoint, "straight", "1")
    await eventually(lambda: moves.beats)
    moves.tell(state="ended", reason="blocked", message="The base does not move.")
    assert await running == 1
    assert "The base does not move." in capfd.readouterr().err
