"""Serves a recorded board on a pseudo-terminal, until it has been played or a signal comes."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from pathlib import Path
from typing import Any

from yahboomd.blackbox.box_file import Header
from yahboomd.blackbox.records import Received, Record, Written
from yahboomd.core import program
from yahboomd.core.clock import seconds
from yahboomd.core.config import Config, read_foreign
from yahboomd.core.protocol.dialect import Dialect
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.port_link import claim
from yahboomd.simulation.pty import PtyPort
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.tools.replay.recorded_wire import WireRecord, connection
from yahboomd.tools.replay.replayed_board import ReplayedBoard
from yahboomd.tools.replay.simulated_robot import as_configured

REPORT_S = 1.0

ANSWERED_NS = 200_000_000
"""The time in which a board has answered."""


def be_a_port(recorded: list[WireRecord], header: Header, link: Path, *, as_json: bool) -> int:
    """Play connections on a pseudo-terminal.

    Raises:
        ConfigError: The link cannot be made, or the black box is from another version.
    """
    config = read_foreign(header.config, "The robot of the black box")
    board = ReplayedBoard(
        recorded, lambda dialect, question: as_configured_says(config, dialect, question)
    )
    complete = asyncio.run(_serve(board, recorded, link))
    facts: dict[str, Any] = {
        "complete": complete,
        "seconds": round(seconds(board.farthest_ns), 3),
        **board.counters,
    }
    print(json.dumps(facts) if as_json else _words(facts))
    return 0


def as_configured_says(config: Config, dialect: Dialect, question: bytes) -> bytes:
    """The answer of a simulated board that stores the recorded configuration's values."""
    robot = SimulatedRobot(as_configured(config, SimulationOptions(dialect=dialect.name)))
    robot.start(0)
    robot.host_wrote(question, 0)
    said = b"".join(robot.host_reads(ANSWERED_NS))
    records = [Record(0, Written(data=question)), Record(0, Received(data=said))]
    answers = connection(dialect, records).answers.get(question, [[]])
    return b"".join(piece.data for piece in answers[0])


async def _serve(board: ReplayedBoard, recorded: list[WireRecord], link: Path) -> bool:
    """Serve until everything was played, or a signal; returns whether everything was."""
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    complete = False

    def end() -> None:
        nonlocal complete
        complete = True
        ended.set()

    board.on_end = end
    port = PtyPort(board, link=link)
    port.on_host = board.host_is_there
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, ended.set)
    with claim(link):
        port.open()
        try:
            many = "" if len(recorded) == 1 else f" in {len(recorded)} connections"
            print(
                f"A recorded {recorded[0].dialect.name} board is at {link} ({port.name}), "
                f"{seconds(board.total_ns):.1f} s{many}; a daemon opens it: "
                f"{program.name()} run --port {link}",
                file=sys.stderr,
                flush=True,
            )
            await _wait(ended, port, board)
        finally:
            port.close()
    return complete


async def _wait(ended: asyncio.Event, port: PtyPort, board: ReplayedBoard) -> None:
    over = asyncio.ensure_future(ended.wait())
    either: set[asyncio.Future[Any]] = {over, port.ended}
    shown = sys.stderr.isatty()
    try:
        while not over.done():
            await asyncio.wait(either, timeout=REPORT_S, return_when=asyncio.FIRST_COMPLETED)
            if port.ended.done():
                await port.ended
            if shown:
                progress = f"{seconds(board.elapsed_ns):.0f} of {seconds(board.total_ns):.0f} s"
                commands = f"{board.counters['motions']} commands for the wheels"
                print(f"\r  {progress}, {commands} ", end="", file=sys.stderr, flush=True)
    finally:
        over.cancel()
        if shown:
            print(file=sys.stderr)


def _words(facts: dict[str, Any]) -> str:
    how = "Played" if facts["complete"] else "Ended by a signal after"
    return (
        f"{how} {facts['seconds']:.1f} s, {facts['bytes']} bytes. The host sent "
        f"{facts['motions']} commands for the wheels and {facts['stops']} stops, which moved "
        f"nothing, {facts['questions']} questions and {facts['polls']} polls."
    )
