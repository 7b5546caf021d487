"""A tap sees every byte in both directions, in order, and the moments that the line uses."""

from __future__ import annotations

from typing import Any

from board_bench import BoardPort

from yahboomd.core.link.line import Line
from yahboomd.core.link.tap import NO_TAP, TappedPort
from yahboomd.core.model import EncoderReading
from yahboomd.core.protocol.registry import DIALECTS
from yahboomd.simulation.options import SimulationOptions
from yahboomd.simulation.robot import SimulatedRobot
from yahboomd.simulation.virtual_time import LoopClock, on_virtual_time


class Notes:
    """A tap that notes its calls."""

    due = True

    def __init__(self) -> None:
        self.seen: list[tuple[Any, ...]] = []

    def opened(self, port: str, byte_ns: int) -> None:
        self.seen.append(("opened", port, byte_ns))

    def received(self, data: bytes, now_ns: int) -> None:
        self.seen.append(("received", data, now_ns))

    def settled(self) -> None:
        self.seen.append(("settled",))

    def noted(self, reading: EncoderReading) -> None:
        self.seen.append(("noted", reading))

    def written(self, data: bytes) -> None:
        self.seen.append(("written", data))

    def identified(self, dialect: str, settings: dict[str, Any] | None) -> None:
        self.seen.append(("identified", dialect))

    def closed(self) -> None:
        self.seen.append(("closed",))


def tapped() -> tuple[BoardPort, Notes, Line]:
    port = BoardPort(SimulatedRobot(SimulationOptions()))
    notes = Notes()
    return port, notes, Line(port, LoopClock(), tap=notes)


@on_virtual_time
async def test_a_tap_sees_a_connection_from_its_port_to_its_end() -> None:
    port, notes, line = tapped()
    async with line.attended():
        line.port.write(b"$read_flash#")
        line._receive(b"half a li")
        line.port.write(b"\n")
    assert notes.seen[:4] == [
        ("opened", port.name, port.byte_ns),
        ("written", b"$read_flash#"),
        ("received", b"half a li", notes.seen[2][2]),
        ("written", b"\n"),
    ]
    # Whatever stopped the wheels at the end was seen, too.
    assert b"".join(each[1] for each in notes.seen if each[0] == "written") == b"".join(
        data for _, data in port.written
    )
    assert notes.seen[-1] == ("closed",)


@on_virtual_time
async def test_it_is_called_when_nothing_is_left_half_read() -> None:
    _, notes, line = tapped()
    async with line.attended():
        line.understand(DIALECTS["streamed"], spacing_ns=0)
        before = len(notes.seen)
        line._receive(b"$MAll:1,2,3,4#\r\n$MAll:1,")
        line._receive(b"2,3,5#\r\n")
        kinds = [each[0] for each in notes.seen[before:]]
        assert kinds == ["received", "received", "settled"]
        notes.due = False
        line._receive(b"$MAll:1,2,3,4#\r\n")
        assert notes.seen[-1][0] == "received"


@on_virtual_time
async def test_the_moment_of_a_read_is_that_of_its_counts() -> None:
    _, notes, line = tapped()
    moments: list[int] = []
    async with line.attended():
        line.understand(DIALECTS["streamed"], spacing_ns=0)
        line.on_counts = lambda reading: moments.append(reading.received_ns)
        line._receive(b"$MAll:1,2,3,4#\r\n")
    (read,) = [each for each in notes.seen if each[:2] == ("received", b"$MAll:1,2,3,4#\r\n")]
    # The line end came behind the counts.
    assert moments[0] == read[2] - 2 * line.port.byte_ns


@on_virtual_time
async def test_without_a_tap_the_port_is_used_as_it_is() -> None:
    port = BoardPort(SimulatedRobot(SimulationOptions()))
    line = Line(port, LoopClock())
    assert line.port is port
    assert line.tap is NO_TAP
    assert not NO_TAP.due


@on_virtual_time
async def test_a_tapped_port_hands_everything_on() -> None:
    port = BoardPort(SimulatedRobot(SimulationOptions()))
    notes = Notes()
    tapped_port = TappedPort(port, notes)
    assert (tapped_port.name, tapped_port.byte_ns) == (port.name, port.byte_ns)
    assert tapped_port.queued() == port.queued()
    tapped_port.discard()
    assert await tapped_port.drain(1.0)
    tapped_port.close()
    assert port.closed
