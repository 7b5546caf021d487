from __future__ import annotations

from yahboomd.client.commanding import ZEROS_NS, Repeater
from yahboomd.core.model import STANDSTILL, Twist2d

FORWARD = Twist2d(vx=0.2)
LEFT = Twist2d(wz=0.5)
S = 1_000_000_000


def test_a_command_is_repeated_until_its_deadline_then_zeros_then_nothing() -> None:
    repeater = Repeater()
    repeater.drive(FORWARD, 2 * S)
    assert repeater.command(2 * S - 1) == FORWARD
    assert repeater.command(2 * S) == STANDSTILL
    assert repeater.command(2 * S + ZEROS_NS - 1) == STANDSTILL
    assert not repeater.idle
    assert repeater.command(2 * S + ZEROS_NS) is None
    assert repeater.idle
    assert repeater.ended == "time"


def test_a_newer_command_replaces_the_one_before_and_its_zeros() -> None:
    repeater = Repeater()
    repeater.drive(FORWARD, S)
    repeater.drive(LEFT, 3 * S)
    assert repeater.command(2 * S) == LEFT
    repeater.stop(2 * S)
    repeater.drive(FORWARD, 3 * S)
    assert repeater.command(2 * S) == FORWARD


def test_a_stop_publishes_zeros_at_once_and_they_end() -> None:
    repeater = Repeater()
    repeater.drive(FORWARD, 9 * S)
    repeater.stop(S)
    assert repeater.command(S) == STANDSTILL
    assert repeater.command(S + ZEROS_NS) is None
    assert repeater.ended == "stop"


def test_after_an_interruption_nothing_is_published_not_even_zeros() -> None:
    repeater = Repeater()
    repeater.drive(FORWARD, 9 * S)
    repeater.interrupt()
    assert repeater.command(S) is None
    assert repeater.idle
    assert repeater.ended == "interrupted"


def test_a_zero_command_is_held_as_long_as_any_other() -> None:
    repeater = Repeater()
    repeater.drive(STANDSTILL, 2 * S)
    assert repeater.command(2 * S - 1) == STANDSTILL
    assert repeater.twist == STANDSTILL
