"""The relay's line: when it toggles. Its kernel and circuit: tests/system/plug/check.py."""

from __future__ import annotations

import pytest

from yahboomd.tools.port.relay import HEARD_MS, next_level, start

NOW_MS = 3_600_000


def test_the_line_toggles_while_the_board_is_heard() -> None:
    levels = [0]
    for _ in range(4):
        levels.append(next_level(levels[-1], NOW_MS - HEARD_MS + 1, NOW_MS))
    assert levels == [0, 1, 0, 1, 0]


@pytest.mark.parametrize("heard_ms", [None, 0, NOW_MS - HEARD_MS])
def test_without_a_port_or_with_a_mute_board_the_line_stays_low(heard_ms: int | None) -> None:
    assert next_level(0, heard_ms, NOW_MS) == next_level(1, heard_ms, NOW_MS) == 0


def test_a_line_that_cannot_be_had_is_named_with_what_follows(capfd) -> None:
    start("/dev/null:17", lambda: NOW_MS)
    said = ""
    while "\n" not in said:
        said += capfd.readouterr().err
    assert "/dev/null:17, the line of the relay (guard.relay), cannot be had: " in said
    assert "The motors have no supply" in said
