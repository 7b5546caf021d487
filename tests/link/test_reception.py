"""From chunks to what the board said."""

from __future__ import annotations

import pytest

from yahboomd.link.gathering import ALIKE
from yahboomd.link.reception import Reception
from yahboomd.protocol.dialect import Battery, Decoded, Item, Totals, Unrecognised
from yahboomd.protocol.four_channel.framing import Frame
from yahboomd.protocol.registry import DIALECTS


class Desk:
    """A reception, what it understood, and a port that records its settings."""

    def __init__(self, dialect: str | None = "streamed") -> None:
        self.heard: list[Decoded] = []
        self.thresholds: list[int] = []
        self.reception = Reception(lambda decoded, _item, _now_ns: self.heard.append(decoded))
        if dialect is not None:
            self.reception.choose(DIALECTS[dialect])

    def gather(self, least: int) -> None:
        self.thresholds.append(least)

    def take(self, *chunks: bytes) -> None:
        for chunk in chunks:
            self.reception.take(chunk, 1_000_000)


def test_before_the_dialect_is_known_only_ears_hear() -> None:
    desk = Desk(None)
    raw: list[tuple[str, Item]] = []
    desk.reception.ears = lambda found_by, item: raw.append((found_by, item))
    desk.take(b"$MAll:1,2,3,4#\r\n")
    frame = Frame(name="MAll", args="1,2,3,4", size=14, trailing=2)
    assert raw == [("streamed", frame), ("polled", frame)]
    assert desk.heard == []


def test_what_came_before_the_dialect_was_known_is_understood_in_it() -> None:
    desk = Desk(None)
    desk.take(b"$data:1,2,3,4#$MAll:5,6,")
    assert desk.reception.choose(DIALECTS["polled"]) == [Totals(ticks=(1, 2, 3, 4))]
    desk.take(b"7,8#\r\n$data:5,6,7,8#")
    assert desk.heard == [Unrecognised(text="$MAll:5,6,7,8#"), Totals(ticks=(5, 6, 7, 8))]
    assert desk.reception.counters.frames == 3


def test_what_repeats_is_decoded_as_it_was() -> None:
    desk = Desk()
    desk.take(b"$MAll:1,2,3,4#\r\n$MAll:1,2,3,4#\r\n", b"$MTEP:1,2,3,4#\r\n$MAll:1,2,3,5#\r\n")
    assert desk.heard[0] == desk.heard[1] == Totals(ticks=(1, 2, 3, 4))
    assert not isinstance(desk.heard[2], Totals)
    assert desk.heard[3] == Totals(ticks=(1, 2, 3, 5))


@pytest.mark.parametrize("dialect", ["streamed", "polled"])
def test_a_frame_of_nothing_is_no_count(dialect: str) -> None:
    desk = Desk(dialect)
    desk.take(b"$#", b"$#", b"$:#", b"$MAll#", b"$data:#")
    assert [type(each) for each in desk.heard] == [Unrecognised] * 5


def test_lines_that_are_alike_are_waited_for_and_half_a_line_ends_that() -> None:
    desk = Desk()
    desk.take(*[b"$MAll:1,2,3,4#\r\n"] * 20)
    assert desk.thresholds == []
    desk.reception.gather(desk)  # type: ignore[arg-type]
    desk.take(*[b"$MAll:1,2,3,4#\r\n"] * (ALIKE + 1))
    assert desk.thresholds == [16]
    desk.take(b"$MAll:1,2,")
    assert desk.thresholds == [16, 1]


def test_other_frames_change_nothing_about_what_is_waited_for() -> None:
    desk = Desk()
    desk.reception.gather(desk)  # type: ignore[arg-type]
    desk.take(*[b"$MAll:1,2,3,4#\r\n"] * (ALIKE + 1), b"$Battery:7.40V#\r\n")
    assert desk.heard[-1] == Battery(volts=7.4)
    assert desk.thresholds == [16]


def test_at_the_end_every_byte_is_heard_as_it_comes() -> None:
    desk = Desk()
    desk.reception.stop_gathering()
    assert desk.thresholds == []
    desk.reception.gather(desk)  # type: ignore[arg-type]
    desk.take(*[b"$MAll:1,2,3,4#\r\n"] * (ALIKE + 1))
    desk.reception.stop_gathering()
    desk.take(*[b"$MAll:1,2,3,4#\r\n"] * 20)
    assert desk.thresholds == [16, 1]


def test_an_end_in_the_midst_of_a_chunk_tells_the_port_nothing_more() -> None:
    desk = Desk()

    def understand(_decoded: Decoded, _item: Item, _now_ns: int) -> None:
        desk.reception.stop_gathering()

    desk.reception = Reception(understand)
    desk.reception.choose(DIALECTS["streamed"])
    desk.reception.gather(desk)  # type: ignore[arg-type]
    desk.take(b"$MAll:1,2,3,4#\r\n" * 20)
    assert desk.thresholds == [1]
